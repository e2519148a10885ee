"""`prismid cache`: what a store of jobs holds, whether it is whole, and removal."""
