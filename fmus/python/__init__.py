"""Kernels of the Python units; each is bundled with slave.py into one unit."""
