"""The runs: scenario files, co-simulation of the units, results and the command line."""
