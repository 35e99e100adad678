"""The parameters to be identified in the coordinates of the search: logarithms, bounds and priors."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.plant.structure import Structure

PRIOR = 0.3  # relative standard deviation of a start value of which nothing else is said
REACH = 100.0  # factor by which a parameter may leave its start, where no bounds are given
_TYPICAL = {"tip_mass": 1e-2, "viscous_damping": 1e-2, "structural_damping": 1e-3}  # scale of a start at 0


def select(structure: Structure, pattern: str, source: str = "") -> list[str]:
    """The parameters that a pattern names: beam[1].density, beam[].density (of all beams), patch[2].*, *.density.

    Raises InputError with the nearest name where there is none.
    """
    names = list(structure.parameters())
    plain = re.sub(r"\[(\d*)\]", lambda m: f"({m[1] or '*'})", pattern)
    found = [name for name in names if fnmatchcase(name.replace("[", "(").replace("]", ")"), plain)]
    if not found:
        general = dict.fromkeys(re.sub(r"\[\d+\]", "[]", name) for name in names)
        raise InputError(pattern, "is not a parameter" + suggestion(pattern, [*names, *general]), source=source)
    return found


@dataclass(frozen=True, kw_only=True)
class ParameterSpace:
    """Free parameters p = start e^x, or start + scale x for a start at 0; x = 0 is the start.

    `deviation` is the prior's standard deviation in x; `declared` says whether the user gave it.
    """

    fixed: dict[str, float]  # the others, SI
    names: tuple[str, ...]
    start: Array  # (p,), SI
    scale: Array  # (p,), SI; the start itself where the coordinate is logarithmic
    logarithmic: NDArray[np.bool_]  # (p,)
    lower: Array  # (p,) in x
    upper: Array  # (p,) in x
    deviation: Array  # (p,) in x
    declared: NDArray[np.bool_]  # (p,)

    def values(self, x: Array) -> dict[str, float]:
        """All parameters at x (p,), the fixed ones too."""
        free = np.where(
            self.logarithmic, self.start * np.exp(np.where(self.logarithmic, x, 0)), self.start + self.scale * x
        )
        return {**self.fixed, **{name: float(v) for name, v in zip(self.names, free, strict=True)}}

    def slopes(self, x: Array) -> Array:
        """dp/dx (p,)."""
        slopes: Array = np.where(self.logarithmic, self.start * np.exp(np.where(self.logarithmic, x, 0)), self.scale)
        return slopes

    def coordinates(self, values: Mapping[str, float]) -> Array:
        """x (p,) of parameters given by name."""
        wanted = np.array([values[name] for name in self.names])
        with np.errstate(divide="ignore", invalid="ignore"):
            x: Array = np.where(self.logarithmic, np.log(wanted / self.start), (wanted - self.start) / self.scale)
        return x

    def without(self, names: set[str], values: Mapping[str, float]) -> "ParameterSpace":
        """The space in which `names` are fixed at `values`."""
        keep = np.array([name not in names for name in self.names], dtype=bool)
        return ParameterSpace(
            fixed={**self.fixed, **{name: float(values[name]) for name in self.names if name in names}},
            names=tuple(name for name in self.names if name not in names),
            start=self.start[keep],
            scale=self.scale[keep],
            logarithmic=self.logarithmic[keep],
            lower=self.lower[keep],
            upper=self.upper[keep],
            deviation=self.deviation[keep],
            declared=self.declared[keep],
        )

    def free_as_well(self, names: Sequence[str]) -> "ParameterSpace":
        """The space in which fixed parameters > 0 of these names, appended, are free too."""
        start = np.array([self.fixed[name] for name in names])
        count = len(names)
        return ParameterSpace(
            fixed={name: value for name, value in self.fixed.items() if name not in names},
            names=(*self.names, *names),
            start=np.concatenate([self.start, start]),
            scale=np.concatenate([self.scale, start]),
            logarithmic=np.concatenate([self.logarithmic, np.ones(count, dtype=bool)]),
            lower=np.concatenate([self.lower, np.full(count, -np.log(REACH))]),
            upper=np.concatenate([self.upper, np.full(count, np.log(REACH))]),
            deviation=np.concatenate([self.deviation, np.full(count, 10 * PRIOR)]),
            declared=np.concatenate([self.declared, np.zeros(count, dtype=bool)]),
        )


def parameter_space(
    structure: Structure,
    *,
    free: list[str] | None = None,
    known: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, float] | None = None,
) -> ParameterSpace:
    """The space around the structure's own values.

    `free` names the parameters to be identified (default all), `known` fixes some at a value, `bounds` are in SI,
    `priors` are relative standard deviations (0.05 is 5 %). Raises InputError where bounds exclude the start or
    nothing is left to identify.
    """
    values = {**structure.parameters(), **(known or {})}
    names = [name for name in (free or list(values)) if name not in (known or {})]
    if not names:
        raise InputError("", "no parameter is left to identify")
    start = np.array([values[name] for name in names])
    logarithmic = start > 0
    scale = np.where(logarithmic, start, [_typical(name, values) for name in names])
    lower = np.where(logarithmic, -np.log(REACH), 0.0)
    upper = np.where(logarithmic, np.log(REACH), REACH)
    space = ParameterSpace(
        fixed={name: value for name, value in values.items() if name not in names},
        names=tuple(names),
        start=start,
        scale=scale,
        logarithmic=logarithmic,
        lower=lower,
        upper=upper,
        deviation=np.array(
            [_deviation(name, priors or {}, known_start) for name, known_start in zip(names, logarithmic, strict=True)]
        ),
        declared=np.array([name in (priors or {}) for name in names]),
    )
    for name, (low, high) in (bounds or {}).items():
        if name in names:
            _tighten(space, names.index(name), name, low, high)
    return space


def _deviation(name: str, priors: Mapping[str, float], logarithmic: bool) -> float:
    if name in priors:
        return float(priors[name])
    return PRIOR if logarithmic else 1.0


def _typical(name: str, values: Mapping[str, float]) -> float:
    """Scale of a parameter that starts at 0: the median of its kind, or a plain guess."""
    kind = name.split(".")[1]
    others = [value for key, value in values.items() if key.endswith(f".{kind}") and value > 0]
    return float(np.median(others)) if others else _TYPICAL.get(kind, 1.0)


def _tighten(space: ParameterSpace, k: int, name: str, low: float, high: float) -> None:
    """Puts bounds in SI into the space."""
    start = space.start[k]
    if not low <= start <= high or low == high:
        raise InputError(f"bounds of {name}", f"must enclose its start {start:g}", [low, high])
    if space.logarithmic[k]:
        space.lower[k] = np.log(low / start) if low > 0 else -np.inf
        space.upper[k] = np.log(high / start)
    else:
        space.lower[k], space.upper[k] = (low - start) / space.scale[k], (high - start) / space.scale[k]
