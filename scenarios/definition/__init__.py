"""What a scenario file may say, and what the command line changes of it."""
