"""Static gains of each patch pair, measured: deflections and strains per volt at rest, with intervals."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.stats import t as student

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.static_maps import StaticMaps

SHORTEST = 1.0  # s, of a plateau whose end counts as rest
RESTING = 30.0  # weight of what is measured before anything moves: it sets the offset
LAST, LATER = 0.7, 0.45  # shares of a plateau that are averaged


def static_maps_of(experiments: Sequence[Experiment], *, pairs: int, points: int, gauges: int) -> StaticMaps:
    """The gains by regression over all plateaus of constant voltage, an offset for each file, and 95 % intervals.

    The value of a plateau is a Hann-weighted mean over its last part, in which oscillations about the rest cancel. What
    is left of them repeats from step to step, so that no scatter shows it; the difference to the mean over a shorter
    part goes into the intervals. Raises InputError where a sensor is missing or the plateaus do not tell the pairs
    apart.
    """
    for experiment in experiments:
        if set(experiment.sensors) != set(range(points + gauges)):
            raise InputError("", "must have the columns of all sensors for static gains", source=experiment.name)
    regressors, answers = _equations(experiments, LAST)
    largest = max(float(np.max(np.abs(regressors[:, :pairs]), initial=0.0)), 1e-300)
    scaled = np.hstack([regressors[:, :pairs] / largest, regressors[:, pairs:]])
    if np.linalg.matrix_rank(scaled, tol=1e-6) < scaled.shape[1]:
        raise InputError(
            "",
            f"the {len(regressors)} plateaus of at least {SHORTEST:g} s do not tell {pairs} pairs and the offsets "
            f"apart; step each pair on its own, from rest",
        )
    inverse = np.linalg.pinv(scaled)
    gains = inverse @ answers
    spare = len(scaled) - scaled.shape[1]
    half = np.abs(inverse @ (_equations(experiments, LATER)[1] - answers))
    if spare > 0:
        deviation = np.sqrt(np.sum((answers - scaled @ gains) ** 2, axis=0) / spare)
        spread = np.sqrt(np.diag(np.linalg.inv(scaled.T @ scaled)))
        half = np.hypot(half, student.ppf(0.975, spare) * np.outer(spread, deviation))
    maps = np.asarray(gains[:pairs].T / largest, dtype=np.float64)
    widths = np.asarray(half[:pairs].T / largest, dtype=np.float64)
    return StaticMaps(
        deflection=maps[:points],
        strain=maps[points:],
        deflection_interval=widths[:points],
        strain_interval=widths[points:],
    )


def _equations(experiments: Sequence[Experiment], share: float) -> tuple[Array, Array]:
    """Voltages and file offsets (k, n_u + files) of the plateaus, sensors' means (k, n_s) over their last share."""
    rows, values = [], []
    for number, experiment in enumerate(experiments):
        order = np.argsort(experiment.sensors)
        for first, last in _plateaus(experiment):
            offsets = np.zeros(len(experiments))
            offsets[number] = 1.0
            certainty = RESTING if first == 0 else 1.0
            rows.append(certainty * np.concatenate([experiment.voltages[first], offsets]))
            begin = 0 if first == 0 else first + int((1 - share) * (last - first))
            weights = np.hanning(last - begin + 2)[1:-1]
            values.append(certainty * weights @ experiment.outputs[begin:last][:, order] / np.sum(weights))
    width = experiments[0].voltages.shape[1] + len(experiments)
    return np.array(rows).reshape(-1, width), np.array(values).reshape(len(rows), -1)


def _plateaus(experiment: Experiment) -> list[tuple[int, int]]:
    """First and last row (exclusive) of the stretches of constant voltage that count."""
    changes = np.flatnonzero(np.any(np.diff(experiment.voltages, axis=0) != 0, axis=1)) + 1
    edges = [0, *(int(c) for c in changes), experiment.rows]
    plateaus = []
    for first, last in pairwise(edges):
        resting = first == 0 and last < experiment.rows
        if (last - first) * experiment.step >= SHORTEST or (resting and last - first >= 10):
            plateaus.append((first, last))
    return plateaus
