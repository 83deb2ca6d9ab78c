"""The noise that was removed, as a shape key of the result: one slider blends it in again, at once, without solving.

The key is made when the slider is first moved: Blender applies no modifier that changes polygons to a mesh with keys.
It lies between the denoised surface, its reference key, and the attribute `noisy_position`.  Needs no NumPy: the panel
asks here.
"""

from __future__ import annotations

from array import array

from bpy.types import Object, ShapeKey

from .result_keys import NOISY_POSITION

NOISE_KEY, DENOISED_KEY = "Noise", "Denoised"


def has_removed_noise(candidate: Object | None) -> bool:
    """Whether an object's mesh knows where its vertices were before their noise was removed."""
    if candidate is None or candidate.type != "MESH":
        return False
    layer = candidate.data.attributes.get(NOISY_POSITION)
    return layer is not None and (layer.data_type, layer.domain) == ("FLOAT_VECTOR", "POINT")


def noise_key(made: Object) -> ShapeKey | None:
    """Return the key that brings an object's noise back, if it has one."""
    keys = made.data.shape_keys if made.type == "MESH" else None
    return keys.key_blocks.get(NOISE_KEY) if keys is not None and keys.use_relative else None


def can_blend(made: Object) -> bool:
    """Whether the noise of an object can be blended in now."""
    keys = made.data.shape_keys if has_removed_noise(made) else None
    if not has_removed_noise(made) or not made.data.is_editable or made.mode == "EDIT":
        return False
    return noise_key(made) is not None or keys is None or keys.use_relative


def strength(made: Object) -> float:
    """Return which share of its noise an object is seen without."""
    key = noise_key(made)
    return 1.0 if key is None else 1.0 - float(key.value)


def set_strength(made: Object, share: float) -> None:
    """Have an object be seen without this share of its noise, from 0 to 1."""
    if not can_blend(made) or (noise_key(made) is None and share == 1.0):
        return
    key = noise_key(made) or _add_key(made)
    key.value = 1.0 - share


def _add_key(made: Object) -> ShapeKey:
    if made.data.shape_keys is None:
        made.shape_key_add(name=DENOISED_KEY, from_mix=False)
    key = made.shape_key_add(name=NOISE_KEY, from_mix=False)
    key.name = NOISE_KEY
    before = array("f", bytes(12 * len(made.data.vertices)))
    made.data.attributes[NOISY_POSITION].data.foreach_get("vector", before)
    key.data.foreach_set("co", before)
    return key
