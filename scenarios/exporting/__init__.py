"""How is a scenario used in another tool? SSP, OSP, closed loop, container, wiring files."""
