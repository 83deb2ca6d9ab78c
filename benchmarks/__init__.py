"""Measurements of speed and accuracy; no tests, nothing here passes or fails.

Times are in *units*: one unit is the time of one product of two 1000 x 1000 float64 matrices on one core, measured
beside each run, so that figures from different machines can be compared.
"""
