"""Child processes and Ctrl-C."""
