"""The case file: its tables, its defaults and the messages of what is wrong in it."""
