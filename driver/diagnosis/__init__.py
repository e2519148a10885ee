"""What the simulation gets wrong, and why: checks, scores, refits, verdict."""
