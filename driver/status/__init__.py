"""The verb `status`: how far a case is, and what it came to."""
