"""German is whole: every string that a user can see has a translation with the same places for values."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import pytest
from bl_ext.user_default.sparse_surface import operators
from bl_ext.user_default.sparse_surface.benchmarks.generated_clouds import ball
from bl_ext.user_default.sparse_surface.operators.data import report_text
from bl_ext.user_default.sparse_surface.operators.data.result_keys import read_report
from bl_ext.user_default.sparse_surface.operators.run.requirements import package_versions
from bl_ext.user_default.sparse_surface.solver.settings import PRESETS
from bl_ext.user_default.sparse_surface.ui import help_panel, menus, translations

sys.path.insert(0, str(Path(__file__).parent))
import scenes

PACKAGE = Path(operators.__file__).parent.parent
PACKAGE_NAME = scenes.EXTENSION

CALLS = {"rpt_", "iface_", "translate"}
"""Functions whose first argument is a sentence for the user."""

SHOWN = {"text", "heading", "title", "confirm_text"}
"""Arguments of layouts that Blender translates."""

SAME = {"LSCM", "OLS", "OMP", "JSON", "Tutte", "SciPy", "NumPy", "scikit-learn", "Sparse Surface"}
"""What a German reads as it is."""


def of_blender() -> Iterator[tuple[str, str]]:
    """Yield what registered classes show: labels, descriptions, properties, items of enumerations."""
    for name in (each for each in dir(bpy.types) if each.startswith("SPARSE_SURFACE_")):
        registered = getattr(bpy.types, name)
        if name == "SPARSE_SURFACE_MT_presets":  # shows the name of the preset that was chosen last
            continue
        if "_OT_" in name:
            shown = getattr(bpy.ops.sparse_surface, name.partition("_OT_")[2]).get_rna_type()
            yield name, shown.name
            yield name, shown.description
            yield from of_properties(name, shown)
        elif "_UL_" not in name:
            yield name, registered.bl_label
    for group in (bpy.context.scene.sparse_surface, add_on_preferences()):
        yield from of_properties(type(group).__name__, group.bl_rna)


def add_on_preferences() -> Any:
    return bpy.context.preferences.addons[PACKAGE_NAME].preferences


def of_properties(place: str, shown: Any) -> Iterator[tuple[str, str]]:
    """Yield what the properties of a class show, and those of the groups that it holds."""
    for each in shown.properties:
        if each.identifier in {"rna_type", "name", "bl_idname"} or each.is_hidden:
            continue
        inner = each.fixed_type if each.type in {"POINTER", "COLLECTION"} else None
        if inner is not None and inner.identifier.startswith("SparseSurface"):
            yield from of_properties(f"{place}.{each.identifier}", inner)
            continue
        yield f"{place}.{each.identifier}", each.name
        yield f"{place}.{each.identifier}", each.description
        for item in each.enum_items if each.type == "ENUM" else ():
            yield f"{place}.{each.identifier}", item.name
            yield f"{place}.{each.identifier}", item.description


def of_code() -> Iterator[tuple[str, str]]:
    """Yield every literal in a call that shows it."""
    for folder in ("ui", "operators"):
        for path in sorted((PACKAGE / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Call):
                    place = f"{path.relative_to(PACKAGE)}:{node.lineno}"
                    yield from ((place, text) for text in _shown_by(node))


def _shown_by(call: ast.Call) -> Iterator[str]:
    name = getattr(call.func, "id", getattr(call.func, "attr", ""))
    given = list(call.args[:1]) if name in CALLS else []
    if not any(each.arg == "translate" for each in call.keywords):
        given += [each.value for each in call.keywords if each.arg in SHOWN]
    for each in given:
        for constant in [each.body, each.orelse] if isinstance(each, ast.IfExp) else [each]:
            if isinstance(constant, ast.Constant) and isinstance(constant.value, str):
                yield constant.value


def of_tables() -> Iterator[tuple[str, str]]:
    """Yield what is shown from tables."""
    for steps in help_panel.STEPS.values():
        yield from (("help", step) for step in steps)
    yield from (("menus", title) for _, title in (*menus.IMPORT, *menus.EXPORT))
    for path in sorted((PACKAGE / "operators").rglob("way_on.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "WayOn":
                yield "way_on", node.args[2].value  # type: ignore[attr-defined]
    for path in sorted((PACKAGE / "solver").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                yield from ((f"progress in {path.name}", text) for text in _said(node))
    yield from (("presets", bpy.path.display_name(name)) for name in PRESETS)
    yield from (("packages", name) for name in package_versions())


def _said(call: ast.Call) -> Iterator[str]:
    """Yield stage and details of a progress, or of a sweep that reports it, with places for their numbers."""
    name = getattr(call.func, "id", getattr(call.func, "attr", ""))
    parts = {"Progress": [*call.args[:1], *call.args[2:3]], "sweep": call.args[:2]}.get(name, [])
    for part in parts:
        if isinstance(part, ast.Constant):
            yield re.sub(r"\d+", "{}", part.value)
        elif isinstance(part, ast.JoinedStr):
            texts = (each.value if isinstance(each, ast.Constant) else "{}" for each in part.values)
            yield "".join(re.sub(r"\d+", "{}", each) for each in texts)


def of_reports() -> Iterator[tuple[str, str]]:
    """Yield the names of the figures of three kinds of reports."""
    scenes.creased_sheet(14)
    made = [scenes.approximate(ring=4, denoise="first", tolerance=0.1)]
    scenes.mesh_object("Scan", ball(300).points, [])
    bpy.context.scene.sparse_surface.reconstruction.corrections = 1
    bpy.ops.sparse_surface.reconstruct()
    made.append(bpy.context.object)
    for each in made:
        report: Any = read_report(each)
        yield from (("rows", label) for label, _ in report_text.rows({**report, "ended_early": True}))
    yield from (("verdict", word) for _, word in report_text.VERDICTS)


def needs_words(text: str) -> bool:
    """Whether there is anything to translate: letters, outside of places for values."""
    return bool(re.search(r"[A-Za-z]{2}", re.sub(r"{[^}]*}", "", text))) and text not in SAME


def missing(found: Iterator[tuple[str, str]]) -> list[str]:
    known = translations.words("de")
    return sorted({f"{place}: {text}" for place, text in found if needs_words(text) and text not in known})


@pytest.mark.parametrize("source", [of_blender, of_code, of_tables, of_reports])
def test_every_string_is_german_too(source: Any):
    found = list(source())
    assert len(found) > 15
    assert missing(iter(found)) == []


def places(text: str) -> list[str]:
    return re.findall(r"{[^}]*}", text)


def test_translations_have_the_same_places_for_values():
    """In the same order: they are filled in by position."""
    for english, german in translations.words("de").items():
        assert places(english) == places(german), english
        assert english.endswith(".") == german.endswith("."), english
        assert english.strip() == english


def test_no_entry_is_left_over():
    """Words that nothing shows would only seem to be checked."""
    shown = {text for source in (of_blender, of_code, of_tables, of_reports) for _, text in source()}
    assert sorted(set(translations.words("de")) - shown) == []


def test_no_sentence_of_a_report_escapes():
    """What a person reads there goes through `translate`: its literals hold no words outside of such a call."""
    tree = ast.parse(Path(report_text.__file__).read_text(encoding="utf-8"))
    inside = {
        id(part)
        for call in ast.walk(tree)
        if isinstance(call, ast.Call)
        for part in ast.walk(call)
        if getattr(call.func, "id", "") == "translate"
    }
    pieces = [part for text in ast.walk(tree) if isinstance(text, ast.JoinedStr) for part in text.values]
    words = [part.value for part in pieces if isinstance(part, ast.Constant) and id(part) not in inside]
    allowed = {" error, ", ", ", "_error"}  # the rows, which are checked by what they give
    assert {text for text in words if re.search("[A-Za-z]{3}", text)} <= allowed


@pytest.fixture
def german() -> Iterator[None]:
    view = bpy.context.preferences.view
    before = view.language
    try:
        view.language = "de_DE"
    except TypeError:
        pytest.skip("this Blender has no translations")
    view.use_translate_interface = view.use_translate_tooltips = view.use_translate_reports = True
    yield
    view.language = before


def test_blender_shows_them(german: None, capfd: pytest.CaptureFixture[str]):
    scenes.creased_sheet(12)
    scenes.approximate(ring=4)
    assert bpy.app.translations.pgettext_iface("Apply to Source", "Operator") == "Auf Quelle anwenden"
    assert bpy.app.translations.pgettext_iface("Domain and Regularisation") == "Gebiet und Regularisierung"
    assert "Fehler der Fläche: rms" in capfd.readouterr().out
    assert bpy.app.translations.pgettext_iface("Statistics") == "Kennzahlen"
