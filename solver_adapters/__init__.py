"""One Simulation in, one Response out; one module or package for each solver."""
