"""Checks of a simulation before it is solved."""
