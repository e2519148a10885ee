"""Parameters from images and loads together (integrated digital image correlation)."""
