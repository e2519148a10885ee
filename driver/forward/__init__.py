"""The forward model: parameters to surface motion and load."""
