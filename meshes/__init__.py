"""The prism, its grains, its surface, and the projection between meshes."""
