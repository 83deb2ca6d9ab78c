"""The surface shown in the viewport while the solver works."""
