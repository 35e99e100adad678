"""How does one run go from its file to its folder? Preparation, execution, jobs in parallel, progress."""
