"""The control of the beams: matrices -> one design that every unit is built from."""
