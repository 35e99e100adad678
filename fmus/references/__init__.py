"""Experiments whose results travel inside a unit."""
