"""Files of format 2 that were made to do harm: refused, or evaluated to finite points, in bounded memory."""

from __future__ import annotations

import io
import json
import lzma
import re
import tracemalloc
import zipfile
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import creased_terrain
from sparse_surface.solver import FileFormatError, Representation, Settings, approximate
from sparse_surface.solver.surface.format.content import SMALL, Sizes

CODINGS = ((0, 0, 0), (3, 0, 0), (0, 2, 2))
QUICK = {"ring": 4, "degree": 8, "sparsity": 8, "iterations": 3, "sweeps": 0}
EXTREMES = (0, 1, -1, 2, 255, 65_536, -(2**31), 2**40)
LARGE = (1e60, -1e60, 1e308, np.inf, np.nan, 0.0, -1.0, 1e-300)


@cache
def file(quality: str) -> bytes:
    surface = approximate(*creased_terrain(14), Settings(**QUICK)).representation
    return surface.compact if quality == "compact" else surface.stored


def chain(coding: int, size: int) -> list[dict[str, int]]:
    lc, lp, pb = CODINGS[coding]
    size = min(max(size, 4096), 1 << 24)
    return [{"id": lzma.FILTER_LZMA2, "preset": 6, "dict_size": size, "lc": lc, "lp": lp, "pb": pb}]


class Forgery:
    """A file taken apart, to be put together with something else in it."""

    def __init__(self, quality: str) -> None:
        with np.load(io.BytesIO(file(quality))) as archive:
            self.head: dict[str, Any] = json.loads(archive["head"].tobytes())
            data = archive["data"].tobytes()
        start = 4 + int.from_bytes(data[:4], "little")
        self.table, self.parts = json.loads(lzma.decompress(data[4:start])), {}
        for name, entry in self.table.items():
            self.parts[name], start = data[start : start + entry[3]], start + entry[3]

    def change(self, name: str, rng: np.random.Generator) -> None:
        """Put other numbers into a block, of which the table then tells the truth."""
        kind, count, coding, _ = self.table[name]
        if coding < 0:
            changed = bytearray(self.parts[name])
            for place in rng.integers(0, max(len(changed), 1), 3) if changed else ():
                changed[place] = rng.integers(256)
            self.parts[name] = bytes(changed)
            return
        width = kind if isinstance(kind, int) else int(kind[1])
        raw = lzma.decompress(self.parts[name], lzma.FORMAT_RAW, filters=chain(coding, width * count))
        planes = np.frombuffer(raw, np.uint8).reshape(width, count).copy()
        if count:
            place = rng.integers(0, count, int(rng.integers(1, 4)))
            if isinstance(kind, str):
                values = np.ascontiguousarray(planes.T).view(f"<{kind}").ravel().astype("<f8")
                values[place] = rng.choice(LARGE)
                planes, kind = values.view(np.uint8).reshape(-1, 8).T, "f8"
            else:
                planes = np.concatenate([planes, np.zeros((6 - width, count), np.uint8)])
                value = int(rng.choice(EXTREMES)) if rng.random() < 0.5 else int(rng.integers(-300, 300))
                folded = (value << 1) ^ (value >> 63)
                planes[:, place] = np.frombuffer(folded.to_bytes(8, "little"), np.uint8)[:6, None]
                kind = 6
        if rng.random() < 0.2:
            planes = np.tile(planes, int(rng.choice([2, 1000])))
        content = np.ascontiguousarray(planes).tobytes()
        self.parts[name] = lzma.compress(content, lzma.FORMAT_RAW, filters=chain(0, len(content)))
        self.table[name] = [kind, planes.shape[1], 0, len(self.parts[name])]

    def replace(self, name: str, place: int, value: int) -> None:
        """Put one other whole number into a block."""
        width, count, coding, _ = self.table[name]
        raw = lzma.decompress(self.parts[name], lzma.FORMAT_RAW, filters=chain(coding, width * count))
        planes = np.frombuffer(raw, np.uint8).reshape(width, count).copy()
        planes[:, place] = np.frombuffer((2 * value).to_bytes(width, "little"), np.uint8)
        content = planes.tobytes()
        self.parts[name] = lzma.compress(content, lzma.FORMAT_RAW, filters=chain(coding, len(content)))
        self.table[name] = [width, count, coding, len(self.parts[name])]

    def content(self) -> bytes:
        table = lzma.compress(json.dumps(self.table).encode(), lzma.FORMAT_ALONE)
        data = b"".join([len(table).to_bytes(4, "little"), table, *self.parts.values()])
        made = io.BytesIO()
        with zipfile.ZipFile(made, "w") as archive:
            for name, part in (("head", json.dumps(self.head).encode()), ("data", data)):
                array = io.BytesIO()
                np.save(array, np.frombuffer(part, dtype=np.uint8))
                archive.writestr(f"{name}.npy", array.getvalue())
        return made.getvalue()


def forged(number: int) -> bytes:
    """Return the forgery of a number: other sizes, other heads, other numbers in blocks, blocks left out."""
    rng = np.random.default_rng(number)
    made = Forgery(("exact", "compact")[number % 2])
    for _ in range(int(rng.integers(1, 3))):
        kind, name = rng.integers(10), str(rng.choice(list(made.table)))
        if kind < 2:
            size = str(rng.choice(list(made.head["sizes"])))
            made.head["sizes"][size] = int(made.head["sizes"][size] * rng.choice([0, 0.5, 2, 1e3, 1e7])) + int(
                rng.integers(2)
            )
        elif kind == 2:
            key = str(rng.choice(["degree", "basis", "blending", "initial"]))
            made.head[key] = {"degree": 5, "basis": "monomial", "blending": "uniform", "initial": ""}[key]
        elif kind == 3 and len(made.table) > 1:
            del made.table[name], made.parts[name]
        elif kind == 4:
            made.table[name][int(rng.integers(1, 4))] = int(rng.choice([0, 1, 2, 10**6, 2**39]))
            break  # what follows could not take the block apart
        else:
            made.change(name, rng)
    return made.content()


def judge(number: int) -> bool:
    """Open and evaluate a forgery; tell whether it could be opened."""
    data = forged(number)
    limit = 10 * max(sizes_memory(data), SMALL)
    tracemalloc.start()
    try:
        surface = Representation.from_bytes(data, "'a.npz'")
    except FileFormatError as refusal:
        sentence = str(refusal)
    else:
        triangle = np.arange(len(surface.triangles))
        points = surface.evaluate(triangle, np.full((len(triangle), 3), 1 / 3))
        assert np.isfinite(points).all(), number
        assert np.isfinite(surface.at_vertices()).all(), number
        return True
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak <= limit, (number, peak)
    assert re.fullmatch(r"'a\.npz' [^\n]*\.", sentence), (number, sentence)
    return False


def sizes_memory(data: bytes) -> int:
    with np.load(io.BytesIO(data)) as archive:
        head = json.loads(archive["head"].tobytes())
    return Sizes(**head["sizes"]).memory(head["degree"]) if len(data) * 1000 > sum(head["sizes"].values()) else 0


def judge_all(numbers: range) -> None:
    opened = sum(judge(number) for number in numbers)
    assert (
        0.02 * len(numbers) < opened < 0.9 * len(numbers)
    )  # forgeries of all kinds: most are noticed, some are harmless


def test_forged_files_do_no_harm() -> None:
    judge_all(range(150))


@pytest.mark.long
def test_a_thousand_forged_files_do_no_harm() -> None:
    judge_all(range(1000))


def test_an_unchanged_file_is_opened() -> None:
    """The tool that forges does not break files by itself."""
    for quality in ("exact", "compact"):
        again = Representation.from_bytes(Forgery(quality).content())
        np.testing.assert_array_equal(again.at_vertices(), Representation.from_bytes(file(quality)).at_vertices())


@pytest.mark.parametrize("change", ["vertices", "patches", "patch_triangles", "functions", "triangles", "nodes"])
def test_sizes_that_would_fill_the_memory_are_refused(change: str) -> None:
    made = Forgery("compact")
    made.head["sizes"][change] = 10**9
    data = made.content()
    tracemalloc.start()
    try:
        with pytest.raises(FileFormatError):
            Representation.from_bytes(data, "'a.npz'")
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("quality", ["exact", "compact"])
def test_a_function_after_the_last_is_refused(quality: str) -> None:
    """There are 45 polynomials of two variables up to degree 8, numbered from 0."""
    support = Representation.from_bytes(file(quality)).support[0, 0]
    last, made = int((support >= 0).sum()) - 1, Forgery(quality)
    if quality == "exact":
        made.replace("exact_support", last, 44)
        assert Representation.from_bytes(made.content()).support[0, 0, last] == 44
        made.replace("exact_support", last, 45)
    else:  # steps from one function of a signal to the next, those of all signals together
        made.replace("support", last * 3 * made.head["sizes"]["patches"], 45 - int(support[last - 1]))
    with pytest.raises(FileFormatError, match="a function is not in its dictionary"):
        Representation.from_bytes(made.content())


def test_two_domains_are_refused() -> None:
    """A coordinate has a domain of its own, or all share one; a file of two, complete in all blocks, is none."""
    surface = Representation.from_bytes(file("exact"))
    twice = {name: np.repeat(getattr(surface, name), 2, axis=0) for name in ("domains", "initial_domains")}
    data = replace(surface, **twice, scales=np.repeat(surface.scales, 2, axis=1)).stored
    with pytest.raises(FileFormatError, match="it has 2 domains for each patch"):
        Representation.from_bytes(data)


def test_patches_that_are_no_disks_are_refused_in_a_sentence() -> None:
    """The maps of forged patches are computed when they are asked for, long after the file was opened."""
    surface = Representation.from_bytes(file("exact"))
    triangles = surface.patch_triangles.copy()
    triangles[: surface.triangle_offsets[1]] = triangles[0]
    forged_surface = replace(surface, patch_triangles=triangles, initial="lscm")
    del forged_surface.__dict__["initial_domains"]
    with pytest.raises(FileFormatError, match="not disks"):
        _ = forged_surface.initial_domains
