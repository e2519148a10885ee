"""Stages of a run, the engine that makes them and the problem that they solve."""
