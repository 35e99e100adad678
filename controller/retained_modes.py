"""Slow modes of the plant that a reduced model does not keep."""

import numpy as np

from flexbeams.controller.reduction import ReducedModel
from flexbeams.plant.damped_modes import ComplexArray

SAME = 0.01  # relative distance of eigenvalues within which the reduced model has a mode
_NAMED = 3


def missing_modes(eigenvalues: ComplexArray, reduced: ReducedModel, beams: int) -> list[tuple[int, float]]:
    """Number, counted from 1, and frequency (rad/s) of the plant's slowest modes that the reduced model lacks.

    `eigenvalues` (k,), 1/s, are those of the plant, of each pair one, the slowest first. The slowest modes are as many
    as beams: all that a model with one mode of each beam can keep.
    """
    slowest = eigenvalues[:beams]
    kept = np.linalg.eigvals(reduced.A)
    return [
        (k, float(abs(value)))
        for k, value in enumerate(slowest, 1)
        if np.min(np.abs(kept - value)) > SAME * np.abs(value)
    ]


def missing_mode_warnings(eigenvalues: ComplexArray, reduced: ReducedModel, beams: int) -> list[str]:
    """A line where slow modes are missing, with their names and what keeps them."""
    missing = missing_modes(eigenvalues, reduced, beams)
    if not missing:
        return []
    named = ", ".join(f"{k} at {frequency:.4g} rad/s" for k, frequency in missing[:_NAMED])
    more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
    return [
        f"the reduced model lacks {len(missing)} of the plant's {beams} slowest modes: {named}{more}; motions and "
        'control leave them out; use a larger reduced_modes, or output_weight = "energy"'
    ]
