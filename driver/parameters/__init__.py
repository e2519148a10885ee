"""Parameters of the general model, each declared once."""
