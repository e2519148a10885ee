"""What happens, in which order: case, experiment, measure, identify, diagnose, report."""
