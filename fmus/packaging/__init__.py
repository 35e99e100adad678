"""From a design to .fmu files: native, Python and closed loop."""
