"""The verb `check`: what is wrong or doubtful in a case, before anything runs."""

# Loaded before anything else loads matplotlib.
from driver.report import drawing_library as drawing_library
