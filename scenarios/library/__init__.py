"""Which scenarios ship? A TOML file for each."""
