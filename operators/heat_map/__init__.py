"""Errors as colours: scale, picture, point shapes."""
