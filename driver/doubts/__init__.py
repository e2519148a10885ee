"""What of a case is odd, told by `check` and at the start of a run: all but images and cost."""
