"""Representations as small files: what can be found again is not stored, and the rest is predicted (docs/format.md)."""
