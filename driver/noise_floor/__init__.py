"""The virtual laboratory: what correlation makes of known motions of the user's own reference."""
