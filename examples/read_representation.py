"""Read a representation that Sparse Surface saved, and evaluate it: NumPy alone, as docs/format.md describes it.

    python read_representation.py model.npz        writes model.obj, the surface at the mesh's vertices

It reads files of the quality "plain", and is made to be read, not to be fast: it checks nothing of what a file says,
and leaves out what closes a surface along its creases.
"""

import json
import lzma
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np


class Blocks(dict):
    """The blocks of a file by name."""

    def __init__(self, data):
        start = 4 + int.from_bytes(data[:4], "little")
        for name, (kind, count, coding, size) in json.loads(lzma.decompress(data[4:start])).items():
            part, start = data[start : start + size], start + size
            if coding < 0:
                self[name] = np.frombuffer(part, "<" + kind)
                continue
            planes = kind if isinstance(kind, int) else int(kind[1])
            chain = {"id": lzma.FILTER_LZMA2, "preset": 6, "dict_size": min(max(planes * count, 4096), 1 << 24)}
            chain |= zip(("lc", "lp", "pb"), ((0, 0, 0), (3, 0, 0), (0, 2, 2))[coding], strict=True)
            raw = np.frombuffer(lzma.decompress(part, lzma.FORMAT_RAW, filters=[chain]), np.uint8).reshape(
                planes, count
            )
            if isinstance(kind, str):
                self[name] = np.ascontiguousarray(raw.T).view("<" + kind)[:, 0].astype(float)
            else:
                folded = (raw.astype(np.int64) << 8 * np.arange(planes)[:, None]).sum(axis=0)
                self[name] = (folded >> 1) ^ -(folded & 1)


def read(path):
    """Return everything that a file leads to, by the names of docs/format.md."""
    with np.load(path, allow_pickle=False) as archive:
        head, b = json.loads(archive["head"].tobytes()), Blocks(archive["data"].tobytes())
    if head["quality"] != "plain":
        raise SystemExit(f"{path} is {head['quality']}: load it and save it with quality='plain'.")
    V, T, N, K = (head["sizes"][name] for name in ("vertices", "triangles", "nodes", "patches"))
    if "face_sizes" in b:
        first = np.cumsum([0, *b["face_sizes"]])[np.cumsum(b["polygons"])]
        tri = np.cumsum(b["face_corners"])[first[:, None] + b["triangle_places"].reshape(T, 3)]
    else:
        c2 = np.cumsum(b["triangles_1"] + b["triangles_2"])
        tri = np.stack([np.cumsum(b["triangles_0"]), c2 - b["triangles_2"], c2], axis=1)
    nodes = tri.ravel().copy()
    nodes[np.cumsum(b["cut_corners"])] = V + b["cut_nodes"]
    nodes, vertex = nodes.reshape(T, 3), np.zeros(N, dtype=int)
    vertex[nodes], proper = tri, (nodes != np.roll(nodes, 1, axis=1)).all(axis=1)
    around, patches, depths = np.bincount(nodes[proper].ravel(), minlength=len(vertex)), [], []
    more = np.split(np.cumsum(b["more_triangles"]), np.cumsum(b["more_sizes"])[:-1])
    for centre, ring, extra in zip(np.cumsum(b["centres"]), b["rings"], more, strict=True):
        ball, held = np.arange(len(vertex)) == centre, np.zeros(T, dtype=bool)
        for _ in range(ring):
            held = ball[nodes].any(axis=1) & proper
            ball[nodes[held]] = True
        held[extra] = True
        own, local = np.unique(nodes[held], return_inverse=True)
        local, depth = local.reshape(-1, 3), np.full(len(own), -1)
        depth[np.bincount(local.ravel()) < around[own]], step = 0, 0
        while (depth < 0).any() and (depth == step).any():
            near, step = local[(depth[local] == step).any(axis=1)], step + 1
            depth[near] = np.where(depth[near] < 0, step, depth[near])
        patches.append((np.flatnonzero(held), own, local))
        depths.append(np.where(depth < 0, 1, depth))
    starts = np.cumsum([0, *(len(own) for _, own, _ in patches)])
    patch, held = np.repeat(np.arange(K), np.diff(starts)), np.concatenate([p[0] for p in patches])
    triangle_starts = np.cumsum([0, *(len(triangles) for triangles, _, _ in patches)])
    names = vertex[np.concatenate([p[1] for p in patches])]
    corners = np.concatenate([p[2] + first for p, first in zip(patches, starts, strict=False)])
    if "weights" in b:
        weights = b["weights"]
    else:
        uniform = head["blending"] == "uniform"
        raw = np.ones(len(names)) if uniform else np.concatenate(depths) ** 1.5 * 1000.0 ** b["levels"][patch]
        raw[np.isin(names, np.cumsum(b["passed_through"]))] = 0.0
        total = np.bincount(names, raw, V)[names]
        weights = np.divide(raw, total, out=np.zeros_like(raw), where=raw > 0.0)
    at = b["exact_vertices"].reshape(3, V).T
    domains = b["exact_domains"].reshape(head["sizes"]["domains"], -1, 2)
    support, factor = (b[f"exact_{name}"].reshape(K, 3, -1) for name in ("support", "coefficients"))
    frames = b["exact_origins"].reshape(K, 3), b["exact_scales"].reshape(K, -1)
    pairs = np.array([(total - j, j) for total in range(head["degree"] + 1) for j in range(total + 1)])
    return SimpleNamespace(
        head=head,
        vertices=at,
        triangles=tri,
        patch=np.repeat(np.arange(K), np.diff(triangle_starts)),
        held=held,
        corners=corners,
        weights=weights,
        domains=domains,
        frames=frames,
        degrees=pairs[support],
        coefficients=np.where(support < 0, 0.0, factor),
    )


def evaluate(surface, triangle, barycentric):
    """Return points of the surface, (N, 3), at barycentric coordinates (N, 3) in triangles (N,)."""
    legendre, degree = surface.head["basis"] == "legendre", surface.head["degree"]
    table = np.polynomial.legendre.legvander if legendre else np.polynomial.polynomial.polyvander
    points, left = np.zeros((len(triangle), 3)), np.ones(len(triangle))
    holders = np.bincount(surface.held, minlength=len(surface.triangles))
    order = np.argsort(triangle, kind="stable")
    first, end = (np.searchsorted(triangle[order], surface.held, side=side) for side in ("left", "right"))
    for n in np.flatnonzero(end > first):
        asked, own, k = order[first[n] : end[n]], surface.corners[n], surface.patch[n]
        weights = surface.weights[own]
        if surface.head["blending"] == "uniform":
            weights = (weights > 0.0) / holders[surface.held[n]]
        inside = barycentric[asked] @ surface.domains[:, own]  # (C, n, 2)
        tables = table(inside / (1.05 if legendre else 1.0), degree)
        (origins, scales), phi = surface.frames, barycentric[asked] @ weights
        for axis in range(3):
            channel = axis % len(surface.domains)
            (i, j), factor = surface.degrees[k, axis].T, surface.coefficients[k, axis]
            value = (tables[channel, :, 0, i] * tables[channel, :, 1, j] * factor[:, None]).sum(axis=0)
            points[asked, axis] += phi * (origins[k, axis] + value / scales[k, channel])
        left[asked] -= phi
    flat = np.einsum("nk,nkd->nd", barycentric, surface.vertices[surface.triangles[triangle]])
    return points + np.where(left > 1e-9, left, 0.0)[:, None] * flat


def main(source):
    """Write the surface at the vertices of its mesh, beside the file."""
    surface = read(source)
    vertex, place = np.unique(surface.triangles, return_index=True)
    points = surface.vertices.copy()
    points[vertex] = evaluate(surface, place // 3, np.eye(3)[place % 3])
    lines = ["v {:.9g} {:.9g} {:.9g}".format(*point) for point in points]
    lines += ["f {} {} {}".format(*corners) for corners in surface.triangles + 1]
    Path(source).with_suffix(".obj").write_text("\n".join(lines) + "\n", encoding="ascii")


if __name__ == "__main__":
    main(sys.argv[1])
