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
LAST = 0.7  # share of a plateau that is averaged
LATER = (0.6, 0.5, 0.42, 0.35)  # shares whose means show what is left of oscillations


def static_maps_of(experiments: Sequence[Experiment], *, pairs: int, points: int, gauges: int) -> StaticMaps:
    """The gains by regression over all plateaus of constant voltage, an offset for each file, and 95 % intervals.

    The value of a plateau is a Hann-weighted mean over its last part, in which oscillations about the rest cancel. What
    is left of them repeats from step to step, so that no scatter shows it; the largest difference to means over shorter
    parts goes into the intervals. So does the noise: the larger one of what white noise of the rows' size does to the
    means, and of the scatter of the plateaus about the fit. Raises InputError where a sensor is missing or the plateaus
    do not tell the pairs apart.
    """
    for experiment in experiments:
        if set(experiment.sensors) != set(range(points + gauges)):
            raise InputError("", "must have the columns of all sensors for static gains", source=experiment.name)
    regressors, answers, variances = _equations(experiments, LAST)
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
    left = np.max([np.abs(inverse @ (_equations(experiments, share)[1] - answers)) for share in LATER], axis=0)
    noise = 1.96 * np.sqrt(inverse**2 @ variances)
    if spare > 0:
        deviation = np.sqrt(np.sum((answers - scaled @ gains) ** 2, axis=0) / spare)
        spread = np.sqrt(np.diag(np.linalg.inv(scaled.T @ scaled)))
        noise = np.maximum(noise, student.ppf(0.975, spare) * np.outer(spread, deviation))
    half = np.hypot(left, noise)
    maps = np.asarray(gains[:pairs].T / largest, dtype=np.float64)
    widths = np.asarray(half[:pairs].T / largest, dtype=np.float64)
    return StaticMaps(
        deflection=maps[:points],
        strain=maps[points:],
        deflection_interval=widths[:points],
        strain_interval=widths[points:],
    )


def _equations(experiments: Sequence[Experiment], share: float) -> tuple[Array, Array, Array]:
    """Voltages and file offsets (k, n_u + files) of the plateaus, sensors' means over their last share and the
    variances of these by white noise (k, n_s), whose size the differences of neighbouring rows show."""
    rows, values, variances = [], [], []
    for number, experiment in enumerate(experiments):
        order = np.argsort(experiment.sensors)
        for first, last in plateaus(experiment):
            offsets = np.zeros(len(experiments))
            offsets[number] = 1.0
            certainty = RESTING if first == 0 else 1.0
            rows.append(certainty * np.concatenate([experiment.voltages[first], offsets]))
            mean, variance = plateau_mean(experiment, first, last, share)
            values.append(certainty * mean[order])
            variances.append(certainty**2 * variance[order])
    width = experiments[0].voltages.shape[1] + len(experiments)
    shape = (len(rows), -1)
    return np.array(rows).reshape(-1, width), np.array(values).reshape(shape), np.array(variances).reshape(shape)


def plateau_mean(experiment: Experiment, first: int, last: int, share: float) -> tuple[Array, Array]:
    """Hann-weighted means (n_s,) over the last share of a plateau, the whole of a first one, and their variances by
    white noise of the size that differences of neighbouring rows show."""
    begin = 0 if first == 0 else first + int((1 - share) * (last - first))
    weights = np.hanning(last - begin + 2)[1:-1]
    weights = weights / np.sum(weights)
    outputs = experiment.outputs[begin:last]
    variance = np.sum(weights**2) * np.mean(np.diff(outputs, axis=0) ** 2, axis=0) / 2
    return np.asarray(weights @ outputs), np.asarray(variance)


def plateaus(experiment: Experiment) -> list[tuple[int, int]]:
    """First and last row (exclusive) of the stretches of constant voltage that count."""
    changes = np.flatnonzero(np.any(np.diff(experiment.voltages, axis=0) != 0, axis=1)) + 1
    edges = [0, *(int(c) for c in changes), experiment.rows]
    found = []
    for first, last in pairwise(edges):
        resting = first == 0 and last < experiment.rows
        if (last - first) * experiment.step >= SHORTEST or (resting and last - first >= 10):
            found.append((first, last))
    return found
