"""What a step costs, as ratios within one process."""
