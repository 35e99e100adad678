"""Numbers of a finished run: checks, curves, files."""
