"""Stages of a run, the engine that makes them, and what they will cost."""
