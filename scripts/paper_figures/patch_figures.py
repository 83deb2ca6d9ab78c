"""Figures 1 to 8: one patch at a time."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay
from sparse_surface.solver import Approximation, Representation, Settings, approximate

from .measurements import DEFAULT, FREER, PRINTED, SETTLING, STEPWISE, Notebook, rounded, unit
from .models import PAPER_MODELS
from .page import Page
from .scalar import Fitted, Patch, bent_crease, fit, grid_patch, iterates, smooth
from .shots import BLUE, CYAN, GREEN, YELLOW, Shown, View, shoot

Array = NDArray[np.float64]

VIEW = View(azimuth=-40.0, elevation=38.0)
FREE = replace(FREER, observations="vertices")
"""Beta per vertex, on vertices alone as in the paper."""

TRADITIONAL = Settings(method="traditional")


SMOOTH, CREASE = grid_patch(smooth), grid_patch(bent_crease)
PATCHES = {"smooth": SMOOTH, "crease": CREASE}


SPLIT = 6
"""Parts into which each edge of the domain's triangles is split to show the polynomial."""


def surface(points: Array, values: Array, patch: Patch, colour: tuple[float, float, float]) -> Array:
    """Render scalar data as heights over parameters, framed like the patch's own data."""
    frame = np.column_stack([patch.domain, patch.values])
    frame = np.concatenate([frame * [1, 1, 1.15], np.column_stack([points, np.clip(values, *_range(patch))])])
    return shoot([Shown(np.column_stack([points, values]), patch.triangles, colour)], VIEW, frame=frame)


def over_domain(fitted: Fitted, patch: Patch) -> Array:
    """Render the polynomial h itself, over the whole of the optimised domain."""
    corner = np.array([(i, j) for i in range(SPLIT + 1) for j in range(SPLIT + 1 - i)])
    shares = np.column_stack([corner, SPLIT - corner.sum(axis=1)]) / SPLIT
    points = (shares @ fitted.domain[patch.triangles]).reshape(-1, 2)
    small = Delaunay(corner).simplices
    triangles = (np.arange(len(patch.triangles))[:, None, None] * len(corner) + small).reshape(-1, 3)
    return surface(points, fitted.polynomial(points), replace(patch, triangles=triangles), YELLOW)


def _range(patch: Patch) -> tuple[float, float]:
    return float(patch.values.min()) - 0.1, float(patch.values.max()) + 0.1


def chosen_functions(page: Page, row: int, column: int, fitted: Fitted, title: str) -> None:
    """Draw the dictionary as a triangle of degrees, the chosen functions with their coefficients."""
    panel = page.chart(row, column, title)
    degrees, degree = fitted.dictionary.degrees, fitted.dictionary.degree
    panel.scatter(*degrees.T, s=9, facecolors="none", edgecolors=(0.75, 0.75, 0.75), linewidths=0.6)
    used = fitted.support[fitted.support >= 0]
    size = 12 + 60 * np.sqrt(np.abs(fitted.coefficients[: len(used)]) / np.abs(fitted.coefficients).max())
    panel.scatter(*degrees[used].T, s=size, color=(0.93, 0.52, 0.13))
    panel.set_xlabel("degree in u", labelpad=1)
    panel.set_ylabel("degree in v", labelpad=1)
    panel.set_aspect("equal")
    panel.set_xlim(-1, degree + 1)
    panel.set_ylim(-1, degree + 1)
    panel.spines[["top", "right"]].set_visible(False)


def figure_1(notebook: Notebook) -> Path:
    """Sparse representation of a smooth patch; of a crease without and with domain optimisation."""
    page = Page(3, 4)
    cases = (
        (SMOOTH, TRADITIONAL, "smooth, fixed domain"),
        (CREASE, TRADITIONAL, "crease, fixed domain"),
        (CREASE, STEPWISE, "crease, optimised domain"),
    )
    for row, (patch, settings, name) in enumerate(cases):
        fitted = fit(patch, settings)
        page.picture(row, 0, surface(patch.domain, patch.values, patch, BLUE), f"{name}: input")
        page.domain(row, 1, fitted.domain, patch.triangles, "domain")
        chosen_functions(page, row, 2, fitted, f"{(fitted.support >= 0).sum()} of {fitted.dictionary.size} functions")
        page.picture(row, 3, surface(patch.domain, fitted.values, patch, CYAN), f"result, rms {fitted.final_rms:.1e}")
        notebook.write("figure 1", {name: rounded(fitted.final_rms)})
    return page.save("figure_01")


def figure_2(notebook: Notebook) -> Path:
    """A crease f as composition of a smooth function h with a piecewise linear domain transformation."""
    patch = CREASE
    page = Page(2, 4)
    for row, (name, settings) in enumerate({"paper, Q2 a step at a time": STEPWISE, "default": DEFAULT}.items()):
        fitted = fit(patch, settings)
        page.picture(row, 0, surface(patch.domain, fitted.values, patch, CYAN), f"{name}:\nf = h o Phi over U0")
        page.domain(row, 1, fitted.start, patch.triangles, "U0")
        page.domain(row, 2, fitted.domain, patch.triangles, f"U = Phi(U0), flips: {fitted.flips}")
        page.picture(row, 3, over_domain(fitted, patch), "h over U")
        notebook.write("figure 2", {name: {"rms": rounded(fitted.final_rms), "flips": fitted.flips}})
    return page.save("figure_02")


def figure_3(notebook: Notebook) -> Path:
    """Iterations on the way to a crease."""
    patch = CREASE
    numbers = [1, 5, 15]
    page = Page(3, 1 + len(numbers))
    page.picture(0, 0, surface(patch.domain, patch.values, patch, BLUE), "input")
    page.domain(1, 0, patch.domain, patch.triangles, "initial domain")
    for column, (number, fitted) in enumerate(zip(numbers, iterates(patch, STEPWISE, numbers), strict=True), start=1):
        page.picture(0, column, surface(patch.domain, fitted.values, patch, CYAN), f"iteration {number}")
        page.domain(1, column, fitted.domain, patch.triangles, f"rms {fitted.final_rms:.1e}")
        page.picture(2, column, over_domain(fitted, patch), "h over U")
        notebook.write("figure 3", {f"iteration {number}": rounded(fitted.final_rms)})
    return page.save("figure_03")


COMPARED = {
    "traditional": TRADITIONAL,
    "paper as printed": PRINTED,
    "paper, rho 1, f = b": SETTLING,
    "paper, Q2 a step at a time": STEPWISE,
    "paper, beta per vertex": FREE,
    "default": DEFAULT,
}


@cache
def compared(kind: str) -> dict[str, Fitted]:
    """Fit a patch, "smooth" or "crease", with every method."""
    return {name: fit(PATCHES[kind], settings) for name, settings in COMPARED.items()}


def figure_4(notebook: Notebook) -> Path:
    """Every method on a smooth patch and on a crease."""
    page = Page(4, 1 + len(COMPARED))
    for block, (kind, patch) in enumerate(PATCHES.items()):
        fits = compared(kind)
        largest = float(np.percentile(fits["traditional"].error, 99))
        page.picture(2 * block, 0, surface(patch.domain, patch.values, patch, BLUE), f"{kind}: input")
        page.domain(2 * block + 1, 0, patch.domain, patch.triangles, "initial domain")
        for column, (name, fitted) in enumerate(fits.items(), start=1):
            page.picture(2 * block, column, surface(patch.domain, fitted.values, patch, CYAN), name)
            title = f"rms {fitted.final_rms:.1e}"
            page.error_map(2 * block + 1, column, patch.domain, patch.triangles, fitted.error, largest, title)
            entry = {"rms": rounded(fitted.final_rms), "units": rounded(fitted.seconds / unit()), "flips": fitted.flips}
            notebook.write("figure 4", {f"{kind} {name}": entry})
    return page.save("figure_04")


def figure_5(notebook: Notebook) -> Path:
    """Energy and misfit after each iteration."""
    page = Page(2, 2, width=3.6, height=2.3)
    for row, kind in enumerate(PATCHES):
        energy = page.chart(row, 0, f"{kind}: energy (eq. 3)")
        misfit = page.chart(row, 1, f"{kind}: rms of the misfit")
        for name, fitted in compared(kind).items():
            steps = np.arange(1, len(fitted.energy) + 1)
            style = {"linestyle": "--", "marker": "o" if len(steps) == 1 else ".", "markersize": 4}
            energy.semilogy(steps, fitted.energy, linewidth=1, **style)
            misfit.semilogy(steps, fitted.rms, linewidth=1, label=name, **style)
            notebook.write("figure 5", {f"{kind} {name}": [rounded(value) for value in fitted.rms]})
        for panel in (energy, misfit):
            panel.set_xlabel("iteration", labelpad=1)
            panel.grid(linewidth=0.3, alpha=0.6)
            panel.spines[["top", "right"]].set_visible(False)
    labels = misfit.get_legend_handles_labels()
    page.figure.legend(*labels, loc="outside lower center", ncols=3, fontsize=7, frameon=False)
    return page.save("figure_05")


@cache
def cylinder(settings: Settings) -> Approximation:
    return approximate(*PAPER_MODELS[2].load(), settings)


def creased_patch_of(surface: Representation) -> int:
    """Return the patch that is least flat."""
    scores = []
    for patch in range(surface.patches):
        points = surface.vertices[surface.patch_vertices[slice(*surface.vertex_offsets[patch : patch + 2])]]
        values = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        scores.append(values[2] / values[0])
    return int(np.argmax(scores))


def patch_parts(surface: Representation, patch: int) -> tuple[slice, Array, NDArray[np.int64]]:
    """Return where a patch's vertices stand, its input points (m, 3) and its triangles."""
    vertices = slice(*surface.vertex_offsets[patch : patch + 2])
    triangles = surface.patch_triangles[slice(*surface.triangle_offsets[patch : patch + 2])]
    return vertices, surface.vertices[surface.patch_vertices[vertices]], triangles


def facing(points: Array, model: Array) -> View:
    """Look at a patch from outside of the model, and from above."""
    out = points.mean(axis=0) - 0.5 * (model.min(axis=0) + model.max(axis=0))
    azimuth = np.degrees(np.arctan2(-out[0], -out[1]))
    return View(azimuth=float(azimuth) + 25.0, elevation=35.0)


DOMAINS = {"lscm": "LSCM", "harmonic": "circle, conformal", "tutte": "circle, Tutte"}


def figure_6(notebook: Notebook) -> Path:
    """Three initial domains lead to close results."""
    page = Page(3, 5)
    methods = {"paper": replace(FREER, adaptive=False), "default": replace(DEFAULT, adaptive=False)}
    largest = 0.0
    for row, (kind, name) in enumerate(DOMAINS.items()):
        results = {key: cylinder(replace(settings, initial_domain=kind)) for key, settings in methods.items()}
        for method, result in results.items():
            entry = {key: rounded(result.report["relative"][key]) for key in ("surface_rms", "vertex_rms")}
            notebook.write("figure 6", {f"{method} {kind}": entry})
        own = results["paper"].representation
        vertices, points, triangles = patch_parts(own, creased_patch_of(own))
        values = own.at_patch_vertices[vertices]
        error = np.linalg.norm(values - points, axis=1)
        largest = largest or 2.5 * float(np.sqrt(np.mean(error**2)))
        view, start = facing(points, own.vertices), own.initial_domains[0, vertices]
        page.picture(row, 0, shoot([Shown(points, triangles, BLUE)], view), "input patch")
        page.domain(row, 1, start, triangles, f"initial: {name}")
        page.domain(row, 2, own.domains[0, vertices], triangles, "optimised")
        page.picture(row, 3, shoot([Shown(values, triangles, CYAN)], view, frame=points), "result")
        page.error_map(row, 4, start, triangles, error, largest, f"max {error.max():.1e}")
    return page.save("figure_06")


def figure_7(notebook: Notebook) -> Path:
    """With and without the regularisation of the domain."""
    patch = CREASE
    cases = {
        "beta1 = beta2 = 0": replace(SETTLING, beta1=0.0, beta2=0.0),
        "per vertex, beta2 = 0": replace(FREE, beta2=0.0),
        "per vertex, beta1 = 0": replace(FREE, beta1=0.0),
        "per vertex, both": FREE,
        "Q2 a step at a time": STEPWISE,
        "both as printed": SETTLING,
        "default": DEFAULT,
    }
    page = Page(2, len(cases))
    for column, (name, settings) in enumerate(cases.items()):
        fitted = fit(patch, settings)
        page.domain(0, column, fitted.domain, patch.triangles, f"{name}\nflips: {fitted.flips}")
        page.picture(1, column, surface(patch.domain, fitted.values, patch, CYAN), f"rms {fitted.final_rms:.1e}")
        notebook.write("figure 7", {name: {"flips": fitted.flips, "rms": rounded(fitted.final_rms)}})
    return page.save("figure_07")


def figure_8(notebook: Notebook) -> Path:
    """A geometry patch: x, y and z over one common domain."""
    result = cylinder(replace(DEFAULT, adaptive=False))
    own = result.representation
    patch = creased_patch_of(own)
    vertices, points, triangles = patch_parts(own, patch)
    start, domain = own.initial_domains[0, vertices], own.domains[0, vertices]
    values = own.at_patch_vertices[vertices]
    page = Page(2, 5)
    page.picture(0, 0, shoot([Shown(points, triangles, GREEN)], facing(points, own.vertices)), "input patch")
    page.domain(1, 0, start, triangles, "initial domain")
    for d, axis in enumerate("xyz"):
        heights = (points[:, d] - points[:, d].mean()) * own.scales[patch, 0]
        fitted = (values[:, d] - points[:, d].mean()) * own.scales[patch, 0]
        frame = np.concatenate([np.column_stack([start, heights]), np.column_stack([domain, heights])])
        signal = Shown(np.column_stack([start, heights]), triangles, BLUE)
        page.picture(0, 1 + d, shoot([signal], VIEW, frame=frame), axis)
        over_domain = np.column_stack([domain, fitted])
        page.picture(1, 1 + d, shoot([Shown(over_domain, triangles, YELLOW)], VIEW, frame=frame), f"{axis}: h over U")
    page.picture(0, 4, shoot([Shown(values, triangles, CYAN)], facing(points, own.vertices), frame=points), "result")
    page.domain(1, 4, domain, triangles, "common domain U")
    notebook.write("figure 8", {"rms": rounded(float(np.sqrt(((values - points) ** 2).sum(axis=1).mean())))})
    return page.save("figure_08")
