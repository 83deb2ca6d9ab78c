import bpy

bpy.context.scene.sparse_surface.apply_preset("denoise")
