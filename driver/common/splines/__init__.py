"""Cubic B-splines of images: their coefficients, values and slopes."""
