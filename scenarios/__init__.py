"""How does an experiment run? Scenario files, co-simulation of the units, results, exports, the command line."""
