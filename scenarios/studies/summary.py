"""Figures of a study: what failed, how the measures are distributed, what the inputs explain."""

from dataclasses import asdict
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.schema import Check
from flexbeams.scenarios.studies.dataset import Results
from flexbeams.scenarios.studies.planning import StudyPlan
from flexbeams.scenarios.studies.sensitivity import Sensitivity, sensitivities

QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
WORST = 5  # runs that are named


def study_summary(plan: StudyPlan, results: Results) -> dict[str, Any]:
    """What `--json` prints: numbers of runs, failures, and for each measure quantiles, worst runs, sensitivity."""
    complete = results.complete
    failed = np.flatnonzero(~complete)
    shares = sensitivities(plan, results, range(len(plan.checks)))
    return {
        **{key: value for key, value in plan.header().items() if key not in ("measures", "signals", "fingerprint")},
        "failed": len(failed),
        "checked": _checked(results),
        "failures": [{"run": int(results.numbers[k]), "reason": results.failures[k]} for k in failed.tolist()],
        "measures": {c.name: _measure(plan, results, k, shares[k]) for k, c in enumerate(plan.checks)},
    }


def _checked(results: Results) -> dict[str, Any]:
    """How many runs of the batch kernel went through the units as well, and the largest relative difference."""
    known = results.differences[np.isfinite(results.differences)]
    return {"runs": len(known), "largest_difference": float(known.max()) if len(known) else None}


def _measure(plan: StudyPlan, results: Results, column: int, found: Sensitivity) -> dict[str, Any]:
    check, complete = plan.checks[column], results.complete
    values = results.measures[complete, column]
    if not len(values):
        return {"unit": check.unit, "min": check.min, "max": check.max, "outside": 0}
    worst = np.flatnonzero(complete)[worst_first(check, values)[:WORST]]
    return {
        "unit": check.unit,
        "min": check.min,
        "max": check.max,
        "outside": int(np.count_nonzero(outside(check, values))),
        "quantiles": {f"{q:g}": float(v) for q, v in zip(QUANTILES, np.quantile(values, QUANTILES), strict=True)},
        "mean": float(values.mean()),
        "worst": [{"run": int(results.numbers[k]), "value": float(results.measures[k, column])} for k in worst],
        "sensitivity": {
            "estimator": found.estimator,
            "runs": found.runs,
            "left_out": found.left_out,
            "indices": {group: asdict(index) for group, index in found.indices.items()},
        },
    }


def outside(check: Check, values: Array) -> np.ndarray:
    """Which values break a limit of their measure."""
    low = -np.inf if check.min is None else check.min
    high = np.inf if check.max is None else check.max
    return np.asarray((values < low) | (values > high))


def worst_first(check: Check, values: Array) -> np.ndarray:
    """Indices of values from the worst to the best: far below `min` where that is the only limit, else the largest."""
    only_low = check.min is not None and check.max is None
    return np.argsort(values if only_low else -values, kind="stable")
