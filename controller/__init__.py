"""Control of the beams: matrices -> one design from which every unit is built."""
