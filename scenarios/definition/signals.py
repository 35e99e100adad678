"""External signals, which drive inputs of the units.

A time counts as reached from 1e-9 s before on, so that rounding of k * step cannot shift an edge by a step.
Piecewise constant signals are continuous from the right.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from os.path import isfile
from pathlib import Path

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.schema import Chirp, Input, PseudoRandom, Pulse, Step, Table, Target
from flexbeams.scenarios.definition.time_table import element_index, read_time_table

TIME_TOLERANCE = 1e-9  # s
IMPULSE_TOLERANCE = 0.005  # share of a pulse's impulse that its samples may miss


@dataclass(frozen=True, kw_only=True)
class Signal:
    """A function of time alone: how a run is split into blocks does not change it."""

    width: int  # elements; a signal of width 1 may drive a whole array
    sample: Callable[[Array], Array]  # times (k,) in s, ascending, to values (k, width)
    changes: Array | None = None  # s, of a table's rows or of targets
    ordered_columns: tuple[str, ...] = ()  # names of a table's columns that go by their order


def signal_of(drive: Input, folder: Path, step: float | None = None) -> Signal:
    """The signal of a scenario's input for samples at steps of `step` s; files are relative to `folder`.

    InputError names key and value.
    """
    if drive.step:
        return _step(drive.step)
    if drive.pulse:
        return _pulse(drive.pulse, step)
    if drive.chirp:
        return _chirp(drive.chirp)
    if drive.pseudo_random:
        return _binary(drive.pseudo_random) if drive.pseudo_random.kind == "binary" else _levels(drive.pseudo_random)
    if drive.table:
        return _table(drive, drive.table, folder)
    if drive.targets:
        return _targets(drive.targets)
    assert drive.constant is not None
    value = _row(drive.constant)
    return Signal(width=len(value), sample=lambda time: np.tile(value, (len(time), 1)))


def require_sampled(drive: Input, step: float) -> None:
    """InputError for a signal that is too fast for steps of `step` s."""
    if drive.chirp:
        for key in ("start_frequency", "stop_frequency"):
            if getattr(drive.chirp, key) * step > 0.5:
                raise InputError(
                    f"chirp.{key}", f"must be <= {0.5 / step:g} Hz, half the step rate", getattr(drive.chirp, key)
                )
    if drive.pseudo_random and drive.pseudo_random.hold < step - TIME_TOLERANCE:
        raise InputError("pseudo_random.hold", f"must be at least the step of {step:g} s", drive.pseudo_random.hold)


def loses_impulse(pulse: Pulse, step: float) -> bool:
    """Whether samples held over steps of `step` s miss the impulse by more than IMPULSE_TOLERANCE."""
    if pulse.duration >= 20 * step:  # off by 0.2 % at most
        return False
    first = np.floor(pulse.time / step)
    times = step * (first + np.arange(int(np.ceil(pulse.duration / step)) + 2))
    unit = replace(pulse, impulse=1.0)
    return bool(abs(step * float(_pulse(unit, None).sample(times).sum()) - 1.0) > IMPULSE_TOLERANCE)


def _row(value: float | list[float]) -> Array:
    return np.atleast_1d(np.asarray(value, dtype=float))


def _step(step: Step) -> Signal:
    value = _row(step.value)
    return Signal(width=len(value), sample=lambda time: np.outer(time + TIME_TOLERANCE >= step.time, value))


def _pulse(pulse: Pulse, step: float | None) -> Signal:
    """Half a sine of height pi impulse / (2 duration), whose integral is the impulse.

    Where samples at steps of `step` s would lose the impulse, each value is the mean over the step that it holds for.
    """
    height = np.pi * pulse.impulse / (2 * pulse.duration)
    if not np.isfinite(height):
        raise InputError("pulse.impulse", f"must give a finite height over {pulse.duration:g} s", pulse.impulse)

    def sample(time: Array) -> Array:
        phase = (time - pulse.time) / pulse.duration
        inside = (time + TIME_TOLERANCE >= pulse.time) & (phase < 1)
        return np.where(inside, height * np.sin(np.pi * phase), 0.0)[:, None]

    def impulse_until(time: Array) -> Array:
        phase = np.clip((time - pulse.time) / pulse.duration, 0.0, 1.0)
        return pulse.impulse * np.sin(np.pi / 2 * phase) ** 2

    if step is None or not loses_impulse(pulse, step):
        return Signal(width=1, sample=sample)
    return Signal(width=1, sample=lambda time: ((impulse_until(time + step) - impulse_until(time)) / step)[:, None])


def _chirp(chirp: Chirp) -> Signal:
    """amplitude sin(2 pi c), c the integral of the frequency since `time`."""
    first, ratio = chirp.start_frequency, 1.0
    amplitude = _row(chirp.amplitude)
    if chirp.sweep == "logarithmic":
        ratio = chirp.stop_frequency / chirp.start_frequency

    def sample(time: Array) -> Array:
        tau = time - chirp.time
        inside = (tau + TIME_TOLERANCE >= 0) & (tau + TIME_TOLERANCE < chirp.duration)
        share = np.where(inside, tau, 0.0) / chirp.duration
        if ratio == 1.0:
            slope = 0.0 if chirp.sweep == "logarithmic" else chirp.stop_frequency - first
            cycles = chirp.duration * (first * share + slope * share**2 / 2)
        else:
            cycles = chirp.duration * first * np.expm1(share * np.log(ratio)) / np.log(ratio)
        return np.outer(np.where(inside, np.sin(2 * np.pi * cycles), 0.0), amplitude)

    return Signal(width=len(amplitude), sample=sample)


def _held(signal: PseudoRandom, levels: Callable[[int, int], Array]) -> Signal:
    """Level k from time + k hold on; levels(k, count) gives those from k on, (count, width), within -1 ... 1."""
    amplitude = _row(signal.amplitude)
    duration = np.inf if signal.duration is None else signal.duration

    def sample(time: Array) -> Array:
        tau = time - signal.time + TIME_TOLERANCE
        inside = (tau >= 0) & (tau < duration)
        values = np.zeros((len(time), len(amplitude)))
        if inside.any():
            number = np.floor(tau[inside] / signal.hold).astype(np.int64)
            first = int(number[0])
            values[inside] = levels(first, int(number[-1]) - first + 1)[number - first] * amplitude
        return values

    return Signal(width=len(amplitude), sample=sample)


def _binary(signal: PseudoRandom) -> Signal:
    """+-1 by a maximum-length sequence; elements are offset by equal shares of the period, the first by the seed."""
    sequence, begin = binary_sequence(signal)
    period, width = len(sequence), len(_row(signal.amplitude))
    offsets = begin + np.arange(width) * period // width
    return _held(signal, lambda first, count: sequence[(first + np.arange(count)[:, None] + offsets) % period])


def binary_sequence(signal: PseudoRandom) -> tuple[Array, int]:
    """One period of +-1 of a maximum-length sequence (2^register - 1,), and the number of its first level."""
    from scipy.signal import max_len_seq

    sequence = 2.0 * max_len_seq(signal.register)[0] - 1.0
    return sequence, int(np.random.Philox(key=signal.seed).random_raw() % len(sequence))


def _levels(signal: PseudoRandom) -> Signal:
    """Uniform within -1 ... 1: numbers of the counter-based generator Philox, four to a count, an element a key."""
    width = len(_row(signal.amplitude))

    def levels(first: int, count: int) -> Array:
        begin = first % 4
        raw = [
            np.random.Philox(key=signal.seed + (k << 64), counter=first // 4).random_raw(begin + count)[begin:]
            for k in range(width)
        ]
        return (np.stack(raw, axis=1) >> np.uint64(11)).astype(np.float64) * 2.0**-52 - 1.0

    return _held(signal, levels)


def table_rows(table: Table, to: str, folder: Path) -> Array:
    """Time (s) and the columns chosen, (rows, 1 + width); the file is relative to `folder`.

    Without a choice, columns named like the elements of the input `to` go to these elements, whatever their order in
    the file; columns with other names go by their order.
    """
    return _chosen_columns(table, to, folder)[0]


def _chosen_columns(table: Table, to: str, folder: Path) -> tuple[Array, tuple[str, ...]]:
    """As table_rows, and the names of columns that go by their order rather than by name or by the user's list."""
    path = folder / table.file
    if not isfile(path):
        raise InputError("table.file", "must be a file", str(path))
    rows = read_time_table(path)
    try:
        if table.columns is None:
            values, ordered = rows.elements_of(to), () if rows.belongs_to(to) else tuple(rows.columns)
        else:
            values, names = rows.select(table.columns), rows.names(table.columns)
            ordered = () if names == table.columns else tuple(names)
    except InputError as error:
        raise error.at("", "table.") from None
    return np.column_stack([rows.time, values]), ordered


def column_note(signal: Signal, names: list[str]) -> str:
    """A note where columns of a table drive the elements `names` by their order, since their names are others."""
    numbers = [element_index(column) for column in signal.ordered_columns]
    if len(numbers) != len(names) or len(names) < 2 or numbers == [element_index(n) for n in names]:
        return ""
    pairs = ", ".join(f"{column} to {name}" for column, name in zip(signal.ordered_columns, names, strict=True))
    return f"columns go by their order: {pairs}"


def skipped_rows(signal: Signal, step: float, steps: int) -> int:
    """How many changes of a table or of targets no step of a run sees, since the next one comes before the sample."""
    if signal.changes is None:
        return 0
    samples = np.ceil((signal.changes - TIME_TOLERANCE) / step).clip(min=0)
    return int(np.count_nonzero((np.diff(samples) == 0) & (samples[:-1] > 0) & (samples[:-1] <= steps)))


def _table(drive: Input, table: Table, folder: Path) -> Signal:
    rows, ordered = _chosen_columns(table, drive.to, folder)
    times, values = rows[:, 0], rows[:, 1:]

    with np.errstate(over="ignore"):
        steep = ~np.isfinite(np.diff(values, axis=0) / np.diff(times)[:, None]).all(axis=1)
    if table.hold == "linear" and steep.any():
        row = int(np.argmax(steep))
        raise InputError("table.file", "must have finite slopes between its rows", f"none behind {times[row]:g} s")

    def hold(time: Array) -> Array:
        return values[np.maximum(np.searchsorted(times, time + TIME_TOLERANCE, side="right") - 1, 0)]

    def join(time: Array) -> Array:
        return np.stack([np.interp(time, times, column) for column in values.T], axis=1)

    return Signal(
        width=values.shape[1],
        sample=hold if table.hold == "zero" else join,
        changes=times,
        ordered_columns=ordered,
    )


def _targets(targets: list[Target]) -> Signal:
    sizes = sorted({len(t.value) for t in targets})
    if len(sizes) != 1:
        raise InputError("targets", "must all have the same number of values", sizes)
    values = np.array([np.zeros(sizes[0]), *[t.value for t in targets]])
    times = [t.time for t in targets]
    return Signal(
        width=sizes[0],
        sample=lambda time: values[np.searchsorted(times, time + TIME_TOLERANCE, side="right")],
        changes=np.array(times),
    )
