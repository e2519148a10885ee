"""The verb `virtual`: data of a specimen that nobody tested."""
