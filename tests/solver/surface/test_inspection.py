"""What is shown of patches against the surface itself and against searches by hand."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest
from numpy.polynomial import legendre
from sparse_surface.benchmarks.generated_models import cube, moebius
from sparse_surface.solver import InputError, Representation, Settings, approximate
from sparse_surface.solver.surface.inspection import (
    domain_atlas,
    face_patches,
    patch_energy,
    patch_sheet,
    patch_terms,
    single_patch,
)

QUICK = {"ring": 3, "degree": 6, "sparsity": 7, "iterations": 4, "sweeps": 1}
KINDS: dict[str, dict[str, object]] = {
    "common": {},
    "separate": {"domains": "separate"},
    "monomials": {"basis": "monomial", "blending": "uniform"},
}


@cache
def representation(kind: str = "common", mesh: str = "cube") -> Representation:
    vertices, faces = cube(6) if mesh == "cube" else moebius(36, 6)
    return approximate(vertices, faces, Settings(**{**QUICK, **KINDS[kind]})).representation


def value_of(name: str, u: float, v: float) -> float:
    """Read a function's name as a person would."""
    value = 1.0
    for factor in name.split():
        if match := re.fullmatch(r"P(\d+)\((u|v)\)", factor):
            where = (u if match[2] == "u" else v) / 1.05
            value *= legendre.legval(where, [0.0] * int(match[1]) + [1.0])
        elif match := re.fullmatch(r"(u|v)(?:\^(\d+))?", factor):
            value *= (u if match[1] == "u" else v) ** int(match[2] or 1)
        else:
            assert factor == "1"
    return float(value)


@pytest.mark.parametrize("kind", list(KINDS))
def test_the_terms_add_up_to_the_patch(kind: str) -> None:
    surface = representation(kind)
    for patch in (0, surface.patches - 1):
        terms = patch_terms(surface, patch)
        assert len({term.name for term in terms}) == len(terms)
        largest = [max(map(abs, term.amounts)) for term in terms]
        assert largest == sorted(largest, reverse=True)
        vertex = surface.vertex_offsets[patch] + 3
        domain = surface.domains[:, vertex]
        for d in range(3):
            u, v = domain[d if len(domain) == 3 else 0]
            total = sum(term.amounts[d] * value_of(term.name, u, v) for term in terms)
            assert surface.origins[patch, d] + total == pytest.approx(surface.at_patch_vertices[vertex, d], abs=1e-10)


def test_at_most_as_many_functions_as_the_settings_allow() -> None:
    surface = representation()
    for patch in range(surface.patches):
        amounts = np.array([term.amounts for term in patch_terms(surface, patch)])
        assert ((amounts != 0.0).sum(axis=0) <= QUICK["sparsity"]).all()


def test_energy_begins_at_one_and_never_rises() -> None:
    surface = representation()
    for patch in range(surface.patches):
        energy = patch_energy(surface, patch)
        assert len(energy) == QUICK["iterations"]
        assert energy[0] == 1.0
        assert energy == sorted(energy, reverse=True)


@pytest.mark.parametrize("kind", list(KINDS))
@pytest.mark.parametrize("splits", [1, 3])
def test_a_sheet_is_the_patch_by_itself(kind: str, splits: int) -> None:
    surface = representation(kind)
    patch = 2
    sheet = patch_sheet(surface, patch, splits)
    rows = slice(*surface.triangle_offsets[patch : patch + 2])
    count = rows.stop - rows.start
    assert len(sheet.triangles) == count * splits**2
    terms = patch_terms(surface, patch)
    for point in range(0, len(sheet.values), 17):
        for d in range(3):
            u, v = sheet.domains[d if len(sheet.domains) == 3 else 0, point]
            total = sum(term.amounts[d] * value_of(term.name, u, v) for term in terms)
            assert surface.origins[patch, d] + total == pytest.approx(sheet.values[point, d], abs=1e-10)
    own = slice(*surface.vertex_offsets[patch : patch + 2])
    size = own.stop - own.start
    np.testing.assert_array_equal(sheet.domains[:, :size], surface.domains[:, own])
    np.testing.assert_array_equal(sheet.initial_domains[:, :size], surface.initial_domains[:, own])
    scale = surface.scales[patch] if len(sheet.domains) == 3 else np.repeat(surface.scales[patch], 3)
    np.testing.assert_allclose(sheet.heights / scale + surface.origins[patch], sheet.values, atol=1e-12)
    for domain in (*sheet.initial_domains, *sheet.domains):
        a, b, c = (domain[sheet.triangles[:, k]] for k in range(3))
        area = np.cross(b - a, c - a)
        assert (area > 0.0).all() or (area < 0.0).all()
    by_hand = patch_sheet(surface, patch).triangles[sheet.source[:: splits**2]]
    np.testing.assert_array_equal(by_hand, surface.patch_triangles[rows])


def test_a_single_patch_is_a_representation_of_its_own() -> None:
    surface = representation()
    alone = single_patch(surface, 1)
    own = slice(*surface.vertex_offsets[1:3])
    np.testing.assert_allclose(alone.at_vertices(), surface.at_patch_vertices[own], atol=1e-13)
    assert alone.patches == 1


@pytest.mark.parametrize("mesh", ["cube", "moebius"])
@pytest.mark.parametrize("kind", ["common", "monomials"])
def test_faces_go_to_the_patch_that_counts_most(kind: str, mesh: str) -> None:
    surface = representation(kind, mesh)
    found = face_patches(surface)
    scores: dict[int, dict[int, list[float]]] = {}
    weights = surface.corner_weights()
    for row, triangle in enumerate(surface.mesh_triangles.tolist()):
        patch = int(surface.patch_of_triangle[row])
        of_face = scores.setdefault(int(surface.polygon[triangle]), {})
        of_face.setdefault(patch, []).append(float(weights[row].sum()))
    for face in range(len(surface.face_offsets) - 1):
        parts = int((surface.polygon == face).sum())
        whole = {patch: sum(s) for patch, s in scores[face].items() if len(s) == parts and sum(s) > 0.0}
        assert found[face] in whole
        assert whole[found[face]] == pytest.approx(max(whole.values()))


@pytest.mark.parametrize("mesh", ["cube", "moebius"])
def test_an_atlas_shows_each_face_once_in_its_patchs_tile(mesh: str) -> None:
    surface = representation("common", mesh)
    best = face_patches(surface)
    across = int(np.ceil(np.sqrt(surface.patches)))
    for domains in (surface.domains[0], surface.initial_domains[0]):
        uv = domain_atlas(surface, domains)
        assert uv.shape == (len(surface.face_corners), 2)
        assert (uv > 0.0).all()
        assert (uv < 1.0).all()
        for face, patch in enumerate(best):
            corners = slice(*surface.face_offsets[face : face + 2])
            column, row = np.floor(uv[corners] * across).astype(int).T
            assert set(zip(row * across + column, strict=True)) == {(patch,)}
            own = slice(*surface.vertex_offsets[patch : patch + 2])
            numbers = [list(surface.patch_vertices[own]).index(v) for v in surface.face_corners[corners]]
            shape, chart = domains[own][numbers], uv[corners]
            ratio = np.linalg.norm(chart[1:] - chart[0], axis=1) / np.linalg.norm(shape[1:] - shape[0], axis=1)
            np.testing.assert_allclose(ratio, ratio[0], rtol=1e-9)


def test_faces_without_a_patch_lie_at_the_origin() -> None:
    vertices, faces = cube(3)
    surface = approximate(vertices, faces, weights=np.zeros(len(vertices))).representation
    assert (face_patches(surface) == -1).all()
    assert not domain_atlas(surface, np.zeros((len(surface.patch_vertices), 2))).any()


@pytest.mark.parametrize("look", [patch_terms, patch_energy, patch_sheet, single_patch])
def test_patches_that_are_not_there_are_refused(look) -> None:  # type: ignore[no-untyped-def]
    surface = representation()
    for patch in (-1, surface.patches):
        with pytest.raises(InputError, match=f"no patch {patch}"):
            look(surface, patch)
