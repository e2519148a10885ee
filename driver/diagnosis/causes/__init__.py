"""Causes of a misfit: their parameters and their sentences."""
