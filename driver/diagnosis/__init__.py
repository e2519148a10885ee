"""What the simulation gets wrong, and why: gates, score, refit, name, extend, gain."""
