"""Specimens, references and programs that tests and benchmarks share."""
