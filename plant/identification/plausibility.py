"""Checks of measured data against the structure at the start, before anything is fitted to them."""

from collections.abc import Sequence

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.identification.channels import is_slow, require_right_channels, require_size
from flexbeams.plant.identification.experiment import Experiment, sensor_names
from flexbeams.plant.identification.sensitivity import drive_of, modal_system, predict
from flexbeams.plant.statespace import static_gains, undamped_frequencies
from flexbeams.plant.structure import Structure

SAMPLES_A_PERIOD = 10.0  # of the last of the r slowest modes, at least
PERIODS = 2.0  # of the slowest mode after the first excitation, at least
CLIPPED = 0.03  # of the slowest period: a flat extreme that lasts longer is a limit of the sensor
_SEGMENT_DEGREE = 5


def require_plausible(structure: Structure, experiments: Sequence[Experiment], free: Sequence[str]) -> None:
    """InputError with column, reason and, where one is obvious, the remedy."""
    model = beam_model(structure, "segment", _SEGMENT_DEGREE)
    frequencies = undamped_frequencies(model.assemble())
    names, period = sensor_names(structure), 2 * np.pi / frequencies[0]
    for experiment in experiments:
        _require_sampling(experiment, frequencies, len(structure.beam))
        _require_live(experiment, names, period)
    _require_excitation(experiments, free)
    resting = [e for e in experiments if e.start == "rest" and not e.uncoupled]
    slow = [e for e in resting if is_slow(e, period)]
    if slow:
        require_right_channels(slow, np.vstack(static_gains(model, model.assemble())), names, period)
    form, _ = modal_system(model, structure.parameters(), [])
    for experiment in (e for e in resting if not is_slow(e, period)):
        require_size(experiment, predict(form, [], drive_of(experiment, model)).outputs.T, names)


def _require_sampling(experiment: Experiment, frequencies: Array, beams: int) -> None:
    fastest = float(frequencies[min(beams, len(frequencies)) - 1])
    samples = 2 * np.pi / (fastest * experiment.step)
    if samples < SAMPLES_A_PERIOD:
        in_ms = samples < 1 <= 1e3 * samples / SAMPLES_A_PERIOD
        raise InputError(
            "column 'time'",
            f"is too coarse: steps of {experiment.step:.4g} s give {samples:.1f} samples a period of mode {beams} "
            f"({fastest:.3g} rad/s), needed are {SAMPLES_A_PERIOD:g}"
            + ("; if it is in ms, give --map 'time=time*0.001'" if in_ms else ""),
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
    """A pair at one voltage throughout shows nothing: what it bends is part of the sensors' zeros."""
    lowest = np.min([np.min(e.voltages, axis=0) for e in experiments], axis=0)
    highest = np.max([np.max(e.voltages, axis=0) for e in experiments], axis=0)
    for k in np.flatnonzero(lowest == highest):
        name, voltage = f"patch[{k + 1}].piezo_ratio", lowest[k]
        if name not in free:
            continue
        fault = f"never changes in any file, so that {name} has no effect"
        if voltage:
            fault = f"is {voltage:g} V in every row of all files: {name} cannot be told from the sensors' zeros"
        raise InputError(f"column 'u[{k + 1}]'", f"{fault}; excite the pair, or give --fix {name}")
