"""Words of the interface in other languages, for Blender's own translation system."""

from __future__ import annotations

import bpy

_GERMAN = {
    "Approximate": "Annähern",
    "Cancel": "Abbrechen",
    "Finish Now": "Jetzt abschließen",
    "Show Heat Map": "Fehlerfarben zeigen",
    "Hide Heat Map": "Fehlerfarben ausblenden",
    "Compare Two Meshes": "Zwei Netze vergleichen",
    "Copy Statistics": "Kennzahlen kopieren",
    "Approximation cancelled": "Annäherung abgebrochen",
    "Switch to Object Mode first": "Erst in den Objektmodus wechseln",
    "Select a mesh": "Ein Netz auswählen",
    "'{}' is hidden: show it first": "„{}“ ist ausgeblendet: erst einblenden",
    "The mesh has no faces": "Das Netz hat keine Flächen",
    "Domain and Regularisation": "Gebiet und Regularisierung",
    "Statistics": "Kennzahlen",
    "Error": "Fehler",
    "inside": "innerhalb",
    "outside": "außerhalb",
}

DICTIONARY = {"de": {("*", english): german for english, german in _GERMAN.items()}}


def register() -> None:
    """Add the words to Blender's."""
    bpy.app.translations.register(__name__, DICTIONARY)


def unregister() -> None:
    """Remove them."""
    bpy.app.translations.unregister(__name__)
