"""How does an agent learn on a scenario? Environments of Gymnasium."""
