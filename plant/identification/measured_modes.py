"""Frequencies, dampings and static gains straight from data, without a model of the structure.

Observer/Kalman filter identification (Juang, Phan, Horta and Longman 1993): a high-order ARX model by linear least
squares over all experiments, its Markov parameters, and the eigensystem realisation algorithm on their Hankel matrix.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lstsq, solve
from scipy.signal import firwin

from flexbeams.plant.basis import Array
from flexbeams.plant.identification.experiment import Experiment

SAMPLES_A_PERIOD = 8.0  # of the highest frequency looked for
LARGEST_DAMPING = 0.1  # ratio; poles beyond are noise or filters
SMALLEST_HANKEL = 2e-3  # singular value that counts, over the largest
SAME = 0.01  # relative distance within which neighbours are one frequency
ROWS_A_COEFFICIENT = 1.5
RIDGE = 1e-3  # acts as noise of this share of the signals, which noise-free data need


@dataclass(frozen=True, kw_only=True)
class MeasuredModes:
    """Modes that data show; k of them, by ascending frequency."""

    frequencies: Array  # (k,), undamped, rad/s
    damping_ratios: Array  # (k,)
    shares: Array  # (k,): part of the outputs' impulse response energy, 0 ... 1
    static_gains: Array  # (n_s, n_u), m/V and 1/V, of the sensors that all experiments have
    sensors: tuple[int, ...]


def measured_modes(experiments: Sequence[Experiment], highest: float) -> MeasuredModes:
    """The modes below `highest` rad/s that most realisations of different order and sampling agree on.

    Raises ValueError where the data are too short for any.
    """
    sensors = tuple(sorted(set.intersection(*(set(e.sensors) for e in experiments))))
    trials = []
    for factor in (0.8, 1.0, 1.25, 1.5):
        for lags in (10, 14, 20, 28):
            trial = _realised_modes(experiments, sensors, factor * highest, lags)
            if trial is not None:
                trials.append(trial)
    if not trials:
        raise ValueError("the data are too short for an ARX model")
    return _agreed(trials, highest)


def _agreed(trials: list[MeasuredModes], highest: float) -> MeasuredModes:
    """Medians of the clusters in which at least half of the trials with a stable mode take part."""
    entries = np.array(
        sorted(
            (frequency, ratio, share, number)
            for number, trial in enumerate(trials)
            for frequency, ratio, share in zip(trial.frequencies, trial.damping_ratios, trial.shares, strict=True)
            if frequency < highest
        )
    ).reshape(-1, 4)
    breaks = np.flatnonzero(np.diff(entries[:, 0]) > SAME * entries[1:, 0]) + 1
    agreeing = max(2.0, sum(len(trial.frequencies) > 0 for trial in trials) / 2)
    clusters = [c for c in np.split(entries, breaks) if len(np.unique(c[:, 3])) >= agreeing]
    modes = np.array([np.median(c[:, :3], axis=0) for c in clusters]).reshape(-1, 3)
    return MeasuredModes(
        frequencies=modes[:, 0],
        damping_ratios=modes[:, 1],
        shares=modes[:, 2],
        static_gains=np.median([trial.static_gains for trial in trials], axis=0),
        sensors=trials[0].sensors,
    )


def _realised_modes(
    experiments: Sequence[Experiment], sensors: tuple[int, ...], highest: float, lags: int
) -> MeasuredModes | None:
    """Modes of one ARX order and sampling rate; None where the rows are too few."""
    stride = max(1, int(2 * np.pi / (SAMPLES_A_PERIOD * highest * experiments[0].step)))
    step = stride * experiments[0].step
    pieces = [_thinned(e, sensors, stride) for e in experiments]
    n_u, n_s = pieces[0][0].shape[1], len(sensors)
    sizes = np.sqrt(np.mean(np.vstack([y for _, y in pieces]) ** 2, axis=0))
    sizes = np.where(sizes > 0, sizes, 1.0)
    amplitude = max(float(np.max(np.abs(np.vstack([u for u, _ in pieces])))), 1e-300)
    long = [(u / amplitude, y / sizes) for u, y in pieces if len(y) > lags]
    width = n_u + lags * (n_u + n_s)
    if sum(len(y) - lags for _, y in long) < ROWS_A_COEFFICIENT * width:
        return None
    wide = np.vstack([_lagged(u, y, lags) for u, y in long])
    ridge = RIDGE * np.linalg.norm(wide) / np.sqrt(width)
    coefficients = lstsq(
        np.vstack([wide, ridge * np.eye(width)]),
        np.vstack([*(y[lags:] for _, y in long), np.zeros((width, n_s))]),
        lapack_driver="gelsy",
    )[0].T  # (n_s, width)
    direct, own, driven = _split(coefficients, n_u, n_s, lags)
    A, B, C = _realisation(_markov(direct, own, driven, 2 * lags)[1:])
    gain = solve(np.eye(n_s) - sum(own), direct + sum(driven))
    return _modes(A, B, C, step, highest, gain * sizes[:, None] / amplitude, sensors)


def _thinned(experiment: Experiment, sensors: tuple[int, ...], stride: int) -> tuple[Array, Array]:
    """Inputs and outputs at every stride-th row after the same low-pass filter."""
    columns = [experiment.sensors.index(s) for s in sensors]
    u, y = experiment.voltages - experiment.rest, experiment.outputs[:, columns]
    y = y - y[0]
    if stride == 1:
        return u, y
    taps = firwin(8 * stride + 1, 0.8 / stride)

    def filtered(values: Array) -> Array:
        padded = np.vstack([np.repeat(values[:1], len(taps) - 1, axis=0), values])
        return np.stack([np.convolve(column, taps, mode="valid") for column in padded.T], axis=1)[::stride]

    return filtered(u), filtered(y)


def _lagged(u: Array, y: Array, lags: int) -> Array:
    """Rows of an ARX regression (len(y) - lags, n_u + lags (n_s + n_u))."""
    parts = [u[lags:]]
    for k in range(1, lags + 1):
        parts += [y[lags - k : len(y) - k], u[lags - k : len(y) - k]]
    wide: Array = np.hstack(parts)
    return wide


def _split(coefficients: Array, n_u: int, n_s: int, lags: int) -> tuple[Array, list[Array], list[Array]]:
    direct = coefficients[:, :n_u]
    blocks = coefficients[:, n_u:].reshape(n_s, lags, n_s + n_u)
    return direct, [blocks[:, k, :n_s] for k in range(lags)], [blocks[:, k, n_s:] for k in range(lags)]


def _markov(direct: Array, own: list[Array], driven: list[Array], count: int) -> list[Array]:
    """Markov parameters of the system from those of the observer."""
    markov = [direct]
    for k in range(1, count + 1):
        value = driven[k - 1] if k <= len(driven) else np.zeros_like(direct)
        markov.append(value + sum(own[j] @ markov[k - 1 - j] for j in range(min(k, len(own)))))
    return markov


def _realisation(markov: list[Array]) -> tuple[Array, Array, Array]:
    """Eigensystem realisation."""
    half = len(markov) // 2
    n_s, n_u = markov[0].shape
    hankel = np.block([[markov[i + j] for j in range(half)] for i in range(half)])
    shifted = np.block([[markov[i + j + 1] for j in range(half)] for i in range(half)])
    U, sizes, Vt = np.linalg.svd(hankel, full_matrices=False)
    order = int(np.sum(sizes > SMALLEST_HANKEL * sizes[0]))
    root = np.sqrt(sizes[:order])
    A = (U[:, :order].T @ shifted @ Vt[:order].T) / root[:, None] / root
    return A, root[:, None] * Vt[:order, :n_u], U[:n_s, :order] * root


def _modes(
    A: Array, B: Array, C: Array, step: float, highest: float, gains: Array, sensors: tuple[int, ...]
) -> MeasuredModes:
    values, vectors = np.linalg.eig(A)
    with np.errstate(divide="ignore"):
        poles = np.log(values.astype(complex)) / step
    inputs, outputs = np.linalg.solve(vectors, B.astype(complex)), C @ vectors
    frequencies = np.abs(poles)
    ratios = -poles.real / np.maximum(frequencies, 1e-300)
    energy = np.sum(np.abs(outputs) ** 2, axis=0) * np.sum(np.abs(inputs) ** 2, axis=1)
    energy = energy / np.maximum(1 - np.minimum(np.abs(values), 0.9999) ** 2, 1e-12)
    real_modes = (poles.imag > 0) & (frequencies < highest) & (ratios > 0) & (ratios < LARGEST_DAMPING)
    chosen = np.flatnonzero(real_modes)
    chosen = chosen[np.argsort(frequencies[chosen])]
    return MeasuredModes(
        frequencies=frequencies[chosen],
        damping_ratios=ratios[chosen],
        shares=energy[chosen] / max(float(np.sum(energy[chosen])), 1e-300),
        static_gains=gains,
        sensors=sensors,
    )
