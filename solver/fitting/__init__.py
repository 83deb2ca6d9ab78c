"""Fitting patches: the dictionary, the pursuit, the domain energy, and the methods that combine them."""
