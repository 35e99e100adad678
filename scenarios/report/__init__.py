"""How is a finished run displayed? Plots, animation and self-contained pages; scripts in `assets/`."""
