"""Short runs and their expected outputs: the reference results that a unit carries.

The expected outputs of each kind of unit are computed independently of both kernels, see its module here.
"""

from dataclasses import dataclass, field

import numpy as np

from flexbeams.plant.basis import Array


@dataclass(frozen=True, kw_only=True)
class Series:
    """Values of variables at some times; two rows of one time are a jump."""

    names: tuple[str, ...]
    time: Array  # (k,), s
    values: Array  # (k, len(names))


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A run from 0 s by equal steps, and its results.

    Inputs are held over a step at their value at its beginning, those without stimuli at their start values. A row of
    `references` has the values after the step that ends at its time, the first row those after the initialisation.
    """

    name: str
    description: str
    step: float  # s
    steps: int
    parameters: dict[str, float | bool] = field(default_factory=dict)  # different from the start values
    stimuli: Series | None = None
    references: Series


def names_of(array: str, size: int) -> list[str]:
    """name[1] .. name[size]."""
    return [f"{array}[{k}]" for k in range(1, size + 1)]


def alternating(size: int, largest: float) -> Array:
    """(size,): largest, -largest / 2, largest / 3 ..."""
    return digits(largest * (-1.0) ** np.arange(size) / np.arange(1, size + 1), 3)


def digits(values: Array, count: int) -> Array:
    """Each value to some significant digits."""
    return np.array([float(f"{v:.{count}g}") for v in values.ravel()]).reshape(values.shape)


def jumps(names: tuple[str, ...], starts: Array, inputs: Array, end: float) -> Series:
    """Inputs (i, n) that hold from starts (i,) s on, until `end` (s)."""
    time = np.concatenate([starts[:1], np.repeat(starts[1:], 2), [end]])
    return Series(names=names, time=time, values=np.repeat(inputs, 2, axis=0))
