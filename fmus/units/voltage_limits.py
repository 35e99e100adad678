"""The limits of the voltages as parameters of a unit: one for all pairs, and two of each pair."""

from typing import Any

from flexbeams.controller.design import Design
from flexbeams.fmus.interface.variables import Variable, array
from flexbeams.fmus.units.ranges import voltage_range

VOLTAGE_LIMITS = ("voltage_limit", "voltage_min", "voltage_max")  # arrays that a kernel finds by value reference


def voltage_limits(design: Design, limited: str) -> tuple[Variable, ...]:
    """voltage_limit, voltage_min[k] and voltage_max[k] of what is `limited`, such as "output voltages".

    Where the design has none for each pair, its voltage_limit holds alone: those of a pair start beyond it, at the ends
    of the plausible range. Zero, the voltage of beams at rest, is always within.
    """
    options, limit, widest = design.options, design.options.voltage_limit, voltage_range(design)
    common: dict[str, Any] = {"causality": "parameter", "variability": "tunable", "unit": "V", "nominal": limit}
    pairs = design.arrays["B_d"].shape[1]
    return (
        Variable(
            name="voltage_limit",
            start=limit,
            minimum=0.0,
            maximum=widest["maximum"],
            description=f"Largest magnitude of the {limited}",
            **common,
        ),
        *array(
            "voltage_min",
            pairs,
            start=options.voltage_min or widest["minimum"],
            maximum=0.0,
            description=f"Lowest of the {limited} of patch pair {{}}, where above -voltage_limit",
            **common,
        ),
        *array(
            "voltage_max",
            pairs,
            start=options.voltage_max or widest["maximum"],
            minimum=0.0,
            description=f"Highest of the {limited} of patch pair {{}}, where below voltage_limit",
            **common,
        ),
    )
