"""The tables of the case file: units in the key names outside, µm, MPa, s, µN inside."""
