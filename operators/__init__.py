"""What the add-on does in Blender: one operator a file, and `mesh_data`, the bridge between meshes and arrays."""
