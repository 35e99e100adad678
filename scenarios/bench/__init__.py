"""What does a step cost? Measurements as ratios within one process, in `native/` the bare loops in C."""
