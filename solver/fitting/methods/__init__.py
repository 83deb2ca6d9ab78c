"""The patch methods, one module each."""
