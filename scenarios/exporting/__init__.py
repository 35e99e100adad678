"""How a scenario leaves the house: SSP, OSP, container, closed loop."""
