"""Are an FMU and a package correct? Structure, and results beside the references inside."""
