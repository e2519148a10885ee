"""Pictures and one self-contained page from the results of a case."""
