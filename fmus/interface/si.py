"""Units of measurement of the variables, as powers of the SI base units.

Names follow FMI's advice: `.` multiplies, digits are powers, at most one `/`.
"""

SI_UNITS: dict[str, dict[str, int]] = {
    "1": {},
    "s": {"s": 1},
    "m": {"m": 1},
    "kg": {"kg": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "1/s": {"s": -1},
    "Hz": {"s": -1},
    "m/s": {"m": 1, "s": -1},
    "kg/m3": {"kg": 1, "m": -3},
    "N/m": {"kg": 1, "s": -2},
    "N.s": {"kg": 1, "m": 1, "s": -1},
    "N.s/m": {"kg": 1, "s": -1},
    "N.s/m2": {"kg": 1, "m": -1, "s": -1},
    "N.m/V": {"s": 1, "A": 1},
    "V.s": {"kg": 1, "m": 2, "s": -2, "A": -1},
    "m.s": {"m": 1, "s": 1},
    "C/m2": {"A": 1, "s": 1, "m": -2},
    "V/s": {"kg": 1, "m": 2, "s": -4, "A": -1},
}
