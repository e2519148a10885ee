"""Before an experiment: what it will say of parameters and causes, and what a change would buy."""

# Loaded before anything else loads matplotlib.
from driver.report import drawing_library as drawing_library
