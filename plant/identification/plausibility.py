"""Checks of measured data against the structure at the start, before anything is fitted to them.

Statics tell most: whatever the frequencies, a sensor's mean follows the voltages by a gain whose sign and size the
start knows to some ten percent. They come from the exact plant, since a few modes may be far off in the strains.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.identification.experiment import Experiment, sensor_names
from flexbeams.plant.statespace import static_gains, undamped_frequencies
from flexbeams.plant.structure import Structure

SAMPLES_A_PERIOD = 10.0  # of the last of the r slowest modes, at least
PERIODS = 2.0  # of the slowest mode after the first excitation, at least
CLIPPED = 0.03  # of the slowest period: a flat extreme that lasts longer is a limit of the sensor
FACTOR = 30.0  # between measured and expected gain, beyond which units differ
SWAPPED = 0.35  # misfit with two sensors exchanged over the misfit as they are, below which they are exchanged
_SEGMENT_DEGREE = 5


def require_plausible(structure: Structure, experiments: Sequence[Experiment], free: Sequence[str]) -> None:
    """InputError with column, reason and, where one is obvious, the remedy."""
    model = beam_model(structure, "segment", _SEGMENT_DEGREE)
    frequencies = undamped_frequencies(model.assemble())
    names = sensor_names(structure)
    for experiment in experiments:
        _require_sampling(experiment, frequencies, len(structure.beam))
        _require_live(experiment, names, 2 * np.pi / frequencies[0])
    _require_excitation(experiments, free)
    resting = [e for e in experiments if e.start == "rest" and not e.uncoupled]
    if resting:
        _require_signs(resting, np.vstack(static_gains(model, model.assemble())), names)


def _require_sampling(experiment: Experiment, frequencies: Array, beams: int) -> None:
    fastest = float(frequencies[min(beams, len(frequencies)) - 1])
    samples = 2 * np.pi / (fastest * experiment.step)
    if samples < SAMPLES_A_PERIOD:
        raise InputError(
            "column 'time'",
            f"is too coarse: steps of {experiment.step:.4g} s give {samples:.1f} samples a period of mode {beams} "
            f"({fastest:.3g} rad/s), needed are {SAMPLES_A_PERIOD:g}",
            source=experiment.name,
        )
    length = experiment.duration - experiment.onset * experiment.step
    if length * frequencies[0] < PERIODS * 2 * np.pi:
        raise InputError(
            "column 'time'",
            f"is too short: {length:.3g} s after the first excitation, needed are {PERIODS:g} periods of the slowest "
            f"mode, {PERIODS * 2 * np.pi / frequencies[0]:.3g} s",
            source=experiment.name,
        )


def _require_live(experiment: Experiment, names: Sequence[str], period: float) -> None:
    """Sensors that never move, or stop at a limit."""
    onset = experiment.onset
    for column, sensor in enumerate(experiment.sensors):
        y = experiment.outputs[:, column]
        if np.ptp(y) == 0:
            raise InputError(
                f"column {names[sensor]!r}", "never changes: a sensor that is not connected", source=experiment.name
            )
        for extreme in (np.max(y), np.min(y)):
            start, length = _longest_run(y[onset + 1 :] == extreme)
            if extreme != y[0] and length * experiment.step > CLIPPED * period and length >= 5:
                raise InputError(
                    f"column {names[sensor]!r}",
                    f"stays at its extreme {extreme:.6g} for {length} rows from row {onset + start + 3} on: saturated "
                    f"or clipped; record with a wider range, or leave the column out",
                    source=experiment.name,
                )


def _longest_run(values: Array) -> tuple[int, int]:
    """Start and length of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], values.astype(int), [0]])))
    starts, lengths = edges[::2], edges[1::2] - edges[::2]
    if not len(starts):
        return 0, 0
    best = int(np.argmax(lengths))
    return int(starts[best]), int(lengths[best])


def _require_excitation(experiments: Sequence[Experiment], free: Sequence[str]) -> None:
    moved = np.max([np.max(np.abs(e.voltages - _rest(e)), axis=0) for e in experiments], axis=0)
    for k in np.flatnonzero(moved == 0):
        name = f"patch[{k + 1}].piezo_ratio"
        if name in free and not any(e.rest_voltages is not None and e.rest_voltages[k] for e in experiments):
            raise InputError(
                f"column 'u[{k + 1}]'",
                f"never changes in any file, so that {name} has no effect; excite the pair, or give --fix {name}",
            )


def _rest(experiment: Experiment) -> Array:
    if experiment.rest_voltages is None:
        return np.zeros(experiment.voltages.shape[1])
    return experiment.rest_voltages


def _require_signs(experiments: Sequence[Experiment], gains: Array, names: Sequence[str]) -> None:
    """Sign, size and order of the sensors' static answers."""
    measured, expected = _static_answers(experiments, gains)
    sensors = sorted(measured)
    size = {s: float(np.linalg.norm(expected[s])) for s in sensors}
    largest = max(size[s] for s in sensors)
    misfit = {
        (a, b): float(np.linalg.norm(measured[a] - expected[b])) / max(size[b], 1e-300)
        for a in sensors
        for b in sensors
    }
    for a, b in combinations(sensors, 2):
        same_kind = names[a][:4] == names[b][:4]
        now, swapped = misfit[a, a] + misfit[b, b], misfit[a, b] + misfit[b, a]
        if same_kind and min(misfit[a, a], misfit[b, b]) > 0.5 and swapped < SWAPPED * now:
            raise InputError(
                f"columns {names[a]!r} and {names[b]!r}",
                f"are exchanged, it seems: the structure explains them {now / max(swapped, 1e-9):.0f} times better the "
                f"other way round; try --map '{names[a]}={names[b]}' --map '{names[b]}={names[a]}'",
            )
    for s in sensors:
        if size[s] < 1e-9 * largest or not np.any(expected[s]):
            continue
        gain = float(measured[s] @ expected[s] / (expected[s] @ expected[s]))
        if abs(gain) > FACTOR or abs(gain) < 1 / FACTOR:
            power = 1000.0 ** round(np.log10(max(abs(gain), 1e-300)) / 3)
            raise InputError(
                f"column {names[s]!r}",
                f"is {abs(gain):.3g} times as large as the structure explains: wrong unit? (SI is expected: m, strain, "
                f"V); try --map '{names[s]}={names[s]}*{1 / power:g}'",
            )
        if gain < -0.3 and misfit[s, s] > 1.0:
            raise InputError(
                f"column {names[s]!r}",
                f"has the wrong sign, it seems: it answers the voltages with {gain:.2g} times what the structure "
                f"explains; try --map '{names[s]}={names[s]}*-1'",
            )


def _static_answers(experiments: Sequence[Experiment], gains: Array) -> tuple[dict[int, Array], dict[int, Array]]:
    """Mean answers to the directions of the voltages, by sensor: measured by regression, and by the static gains."""
    voltages = np.vstack([e.voltages - _rest(e) for e in experiments])
    _, sizes, directions = np.linalg.svd(np.linalg.qr(voltages, mode="r"))
    directions = directions[: int(np.sum(sizes > 1e-3 * sizes[0]))] if sizes[0] > 0 else directions[:0]
    measured: dict[int, Array] = {}
    expected: dict[int, Array] = {}
    for sensor in sorted({s for e in experiments for s in e.sensors}):
        with_sensor = [e for e in experiments if sensor in e.sensors]
        rows, values = [], []
        for experiment in with_sensor:
            y = experiment.outputs[:, experiment.sensors.index(sensor)]
            rows.append((experiment.voltages - _rest(experiment)) @ directions.T)
            values.append(y - np.mean(y[: max(1, experiment.onset)]))
        answer = np.linalg.lstsq(np.vstack(rows), np.concatenate(values), rcond=1e-6)[0]
        scale = sizes[: len(directions)] / sizes[0] if len(directions) else np.ones(0)
        measured[sensor] = answer * scale
        expected[sensor] = directions @ gains[sensor] * scale
    return measured, expected
