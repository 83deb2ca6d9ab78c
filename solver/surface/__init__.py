"""The fitted surface: its representation, evaluation, files, measures, and what can be made from it."""
