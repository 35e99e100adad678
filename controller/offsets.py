"""The map W of the offset-free observer: from strain errors at rest to deflection errors at rest."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError, suggestion
from flexbeams.plant.static_sensitivities import StaticSensitivity

DEFAULT_UNCERTAINTY = 0.1  # half width of every parameter, relative
BLIND = 1e-3  # a gauge whose strain errors are smaller than this fraction of the largest sees no error


@dataclass(frozen=True, kw_only=True)
class OffsetMap:
    """The best linear estimate of the deflection error from the strain error, over the declared uncertainty."""

    W: Array  # (n_pi, n_pm), m
    error_before: float  # rms deflection error with the voltage limit on each pair, m
    error_after: float  # the same with the estimate subtracted, m
    condition: float  # ratio of the largest to the smallest standard deviation among the strain errors
    independent_errors: int  # directions of strain errors above the strain noise
    blind_gauges: tuple[int, ...]  # counted from 1: they see none of the declared errors

    def figures(self) -> dict[str, Any]:
        """For the summary, in JSON's types."""
        return {
            "static_error_before": self.error_before,
            "static_error_after": self.error_after,
            "condition": self.condition,
            "independent_errors": self.independent_errors,
            "blind_gauges": list(self.blind_gauges),
        }


def uncertainty_of(names: list[str], declared: Mapping[str, float] | None) -> dict[str, float]:
    """Relative half width of each of the named parameters that is uncertain.

    Keys such as patch[2].piezo_ratio or, for all pairs, patch[].piezo_ratio; a key for one overrides a key for all.
    None declares DEFAULT_UNCERTAINTY for every parameter. Raises DesignError for a key that names no parameter.
    """
    if declared is None:
        return dict.fromkeys(names, DEFAULT_UNCERTAINTY)
    patterns = {name: re.sub(r"\[\d+\]", "[]", name) for name in names}
    for key in declared:
        if key not in patterns and key not in patterns.values():
            valid = [*dict.fromkeys(patterns.values()), *names]
            raise DesignError(f"uncertainty: {key!r} is not a parameter" + suggestion(key, valid))
    widths = {name: declared.get(name, declared.get(pattern, 0.0)) for name, pattern in patterns.items()}
    return {name: width for name, width in widths.items() if width > 0}


def offset_map(
    sensitivities: Mapping[str, StaticSensitivity], uncertainty: Mapping[str, float], noise: float, voltage: float
) -> OffsetMap:
    """Regression of the deflection error on the strain error, W = S_ym (S_mm + noise^2 I)^-1.

    S are covariances over uniformly distributed parameters within +-uncertainty (relative), to first order, for
    `voltage` V on one pair after the other; noise: standard deviation of the strain offset (m/m).
    """
    errors = [(width / np.sqrt(3), sensitivities[name]) for name, width in uncertainty.items() if name in sensitivities]
    example = next(iter(sensitivities.values()))
    none = np.zeros_like(example.deflection), np.zeros_like(example.strain)
    # (outputs, parameters n_u): one column for each parameter and pair
    y = voltage * np.hstack([none[0], *(deviation * s.deflection for deviation, s in errors)])
    m = voltage * np.hstack([none[1], *(deviation * s.strain for deviation, s in errors)])
    S_mm = m @ m.T
    W = np.linalg.solve(S_mm + noise**2 * np.eye(len(m)), m @ y.T).T
    deviations = np.sqrt(np.maximum(np.linalg.eigvalsh(S_mm), 0.0))
    seen = np.sqrt(np.diag(S_mm))
    pairs = example.deflection.shape[1]
    return OffsetMap(
        W=np.asarray(W, dtype=np.float64),
        error_before=float(np.linalg.norm(y) / np.sqrt(y.shape[0] * pairs)),
        error_after=float(np.linalg.norm(y - W @ m) / np.sqrt(y.shape[0] * pairs)),
        condition=float(deviations[-1] / max(deviations[0], np.finfo(float).tiny)) if deviations[-1] > 0 else 1.0,
        independent_errors=int(np.count_nonzero(deviations > noise)),
        blind_gauges=tuple(int(k) + 1 for k in np.flatnonzero(seen <= BLIND * seen.max())),
    )
