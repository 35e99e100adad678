"""How do coupled units step? Wiring, instances, loops in Python and in C (`native/`), recording."""
