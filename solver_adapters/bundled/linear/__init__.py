"""Linear systems of the tangent."""
