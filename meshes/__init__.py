"""The prism, its grains and its surface; any plane mesh; mesh files."""
