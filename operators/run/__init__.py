"""A run of the solver in Blender: its state, what its operators share, its status, its estimate."""
