"""Finite elements: assembly, cells, fields and states."""
