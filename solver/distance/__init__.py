"""Distances between surfaces that share no polygons: nearest points, signs, certified maxima, alignment."""
