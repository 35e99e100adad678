"""What do third-party co-simulation tools compute? Each runs an exported package unchanged."""
