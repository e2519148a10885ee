"""Campaigns: many cases, variants of a case and virtual experiments, run beside one another."""
