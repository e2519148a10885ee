"""Stored results computed anew elsewhere, and compared number by number."""
