"""What the add-on shows in Blender: properties, panels, presets, the heat map's legend, preferences."""
