"""Co-simulation masters of others, each running an exported package as it is."""
