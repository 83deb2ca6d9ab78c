"""A solver run in Blender: its state, its operator, its status, its estimate."""
