"""The patches of a representation in words and figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..solver.surface.inspection import patch_energy, patch_terms
from ..solver.surface.representation import Representation
from .console import console
from .outputs import write_json


def list_patches(surface: Representation, patch: int | None, report: Path | None) -> None:
    """Print one patch of a representation with its functions, or all in a line each; also to a file where one is named.

    Raises
    ------
    InputError
        When there is no such patch.
    """
    one = patch is not None
    listed = [_describe(surface, number) for number in ([patch] if patch is not None else range(surface.patches))]
    figures = listed[0] if one else listed
    for each in listed:
        energy = each["energy"]
        fell = f", energy {energy[-1]:.3g} of the first iteration's" if energy else ""
        title = f"patch {each['patch']}"
        console.say(f"{title}: {each['vertices']} vertices, {len(each['functions'])} functions{fell}", title)
        for function in each["functions"] if one else ():
            amounts = " ".join(f"{amount:12.4e}" for amount in function["amounts"])
            console.say(f"  {function['name']:<16} {amounts}")
    if report is not None:
        write_json(report, figures)
    console.figures(figures)


def _describe(surface: Representation, patch: int) -> dict[str, Any]:
    """Return number, vertices, functions with their amounts in x, y and z, and energies of a patch."""
    functions = [{"name": term.name, "amounts": list(term.amounts)} for term in patch_terms(surface, patch)]
    size = int(surface.vertex_offsets[patch + 1] - surface.vertex_offsets[patch])
    return {"patch": patch, "vertices": size, "functions": functions, "energy": patch_energy(surface, patch)}
