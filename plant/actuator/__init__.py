"""Actuators of macro-fibre composite: amplifier, hysteresis, creep and their inverse, which need numpy alone."""
