"""The verb `export`: results as VTK files and tables."""
