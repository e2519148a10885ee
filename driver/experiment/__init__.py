"""What was measured: the history of the test, its loads and its height maps."""
