"""Stepping: coupling, recording, instances, the loop in C."""
