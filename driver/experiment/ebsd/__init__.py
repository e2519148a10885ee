"""EBSD maps: their files, the grains in them, and the orientations of grains."""
