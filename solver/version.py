"""The version of the extension, the same in the Blender manifest."""

VERSION = "0.1.0"
