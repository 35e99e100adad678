"""Checks of FMUs and packages: structure and reference results."""
