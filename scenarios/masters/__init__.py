"""Third-party co-simulation masters, each running an exported package unchanged."""
