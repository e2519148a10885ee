"""Height maps before correlation: reading, fixed pattern, noise, rigid motion."""
