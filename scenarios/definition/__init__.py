"""What can a scenario define? Schema, files, signals, settings and their precedence."""
