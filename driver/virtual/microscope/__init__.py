"""The virtual microscope: relief, texture and camera of the images of `virtual`."""
