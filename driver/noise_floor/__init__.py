"""The virtual laboratory: what correlation makes of known motions of the user's own reference."""

# Loaded before anything else loads matplotlib.
from driver.report import drawing_library as drawing_library
