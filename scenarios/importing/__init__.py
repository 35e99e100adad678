"""FMUs and SSP packages of unknown origin."""
