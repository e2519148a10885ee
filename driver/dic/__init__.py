"""Global digital image correlation of height maps."""
