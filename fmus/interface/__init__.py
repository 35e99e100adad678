"""Variables of a unit and units of measurement."""
