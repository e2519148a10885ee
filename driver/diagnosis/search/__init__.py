"""The search of causes: rounds of tests and refits, and the checks of what they name."""
