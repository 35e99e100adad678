"""Channels with a wrong sign, unit or place, found from static answers before anything is fitted.

Whatever the frequencies, a sensor's mean over some periods of the slowest mode follows that of the voltages by a gain
whose sign and size the start knows to some ten percent. Expected gains come from the exact plant, since a few modes may
be far off in the strains.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.plant.identification.experiment import Experiment

FACTOR = 30.0  # between measured and expected gain, beyond which units differ
SWAPPED = 0.35  # misfit with two sensors exchanged over the misfit as they are, below which they are exchanged
DRIVEN = 0.5  # the same for voltages, where all sensors vote
MISFIT = 0.4  # mean over the sensors below which the voltages are taken as right
CANCELLED = 0.4  # expected answer over the root of its squared parts, below which it is a small difference of them
AVERAGED = 2.0  # periods of the slowest mode over which a mean is taken
SLOW = 0.5  # of the voltages' rms that such means keep: those of steps, not those of sweeps
_FEEBLE = 1 / 300  # of the largest voltage: what a column in kV beside others in V shows


@dataclass(frozen=True, kw_only=True)
class StaticAnswers:
    """Mean answers of the sensors to the directions of the voltages, strongest first; d directions."""

    measured: dict[int, Array]  # (d,) by sensor, by regression
    gains: Array  # (n_all, n_u): expected, m/V and 1/V
    directions: Array  # (d, n_u)
    scale: Array  # (d,): size of each direction over the largest

    def expected(self, sensor: int, columns: Array | None = None) -> Array:
        """The answer (d,) by the static gains, the recorded voltages changed by `columns` (n_u, n_u)."""
        gains = self.gains[sensor] if columns is None else self.gains[sensor] @ columns
        answer: Array = self.directions @ gains * self.scale
        return answer

    def is_telling(self, sensor: int) -> bool:
        """Whether the expected answer is more than a small difference of the answers to single voltages."""
        parts = self.directions * self.gains[sensor] * self.scale[:, None]
        size = float(np.linalg.norm(parts))
        return size > 0 and float(np.linalg.norm(self.expected(sensor))) > CANCELLED * size

    def misfit(self, sensor: int, other: int) -> float:
        """Difference of a sensor's answer from what is expected of another one, relative to that."""
        expected = self.expected(other)
        return float(np.linalg.norm(self.measured[sensor] - expected)) / max(float(np.linalg.norm(expected)), 1e-300)

    def total(self, columns: Array) -> float:
        """Mean misfit of all sensors if the recorded voltages were changed by `columns` (n_u, n_u)."""
        misfits = []
        for sensor, measured in self.measured.items():
            expected = self.expected(sensor, columns)
            size = max(float(np.linalg.norm(expected)), float(np.linalg.norm(measured)), 1e-300)
            misfits.append(float(np.linalg.norm(measured - expected)) / size)
        return float(np.mean(misfits))


def is_slow(experiment: Experiment, period: float) -> bool:
    """Whether means over AVERAGED times `period` s keep SLOW of the voltages' rms: steps do, sweeps do not."""
    moved = experiment.voltages - experiment.rest
    means = _means(moved, _window(experiment, period))
    return float(np.mean(means**2)) > SLOW**2 * float(np.mean(moved**2))


def require_right_channels(
    experiments: Sequence[Experiment], gains: Array, names: Sequence[str], period: float
) -> None:
    """InputError for a column with a wrong unit, sign or place in experiments with slow voltages.

    `gains` (n_all, n_u) are those expected, `period` is that of the slowest mode, s.
    """
    answers = static_answers(experiments, gains, period)
    sensors = sorted(answers.measured)
    largest = max(float(np.linalg.norm(answers.expected(s))) for s in sensors)
    telling = [
        s for s in sensors if answers.is_telling(s) and float(np.linalg.norm(answers.expected(s))) > 1e-9 * largest
    ]
    factors = {s: _projection(answers, s) for s in telling}
    _require_voltage_units(experiments, factors)
    _require_voltages(answers)
    _require_order(answers, telling, names)
    for sensor, factor in factors.items():
        _require_sensor(answers, sensor, factor, names[sensor])


def _projection(answers: StaticAnswers, sensor: int) -> float:
    """The factor by which a sensor's answer exceeds the expected one."""
    expected = answers.expected(sensor)
    return float(answers.measured[sensor] @ expected / (expected @ expected))


def _power(factor: float) -> float:
    """The power of 1000 nearest to a factor."""
    return float(1000.0 ** round(np.log10(max(abs(factor), 1e-300)) / 3))


def _require_voltage_units(experiments: Sequence[Experiment], factors: Mapping[int, float]) -> None:
    moved = np.max([np.max(np.abs(e.voltages - e.rest), axis=0) for e in experiments], axis=0)
    for k in np.flatnonzero((moved > 0) & (moved < _FEEBLE * np.max(moved))):
        raise InputError(
            f"column 'u[{k + 1}]'",
            f"reaches {moved[k]:.3g}, another column {np.max(moved):.3g}: wrong unit? (V is expected); try "
            f"--map 'u[{k + 1}]=u[{k + 1}]*{1 / _power(moved[k] / np.max(moved)):g}', or excite the pair more",
        )
    powers = {_power(factor) for factor in factors.values()}
    if len(factors) > 1 and len(powers) == 1 and powers != {1.0}:
        power = powers.pop()
        raise InputError(
            "columns 'u[1]' ...",
            f"are in a wrong unit, it seems: all sensors answer {power:g} times as much as the structure explains (SI "
            f"is expected: V, m, strain); try --map 'u[1]=u[1]*{power:g}' and so on",
        )


def _require_voltages(answers: StaticAnswers) -> None:
    """Sign and order of the voltages, on which all sensors vote."""
    pairs = answers.gains.shape[1]
    now = answers.total(np.eye(pairs))
    if now < MISFIT:
        return
    total, text = min(((answers.total(columns), text) for columns, text in _changes(pairs)), default=(np.inf, ""))
    if total < DRIVEN * now and total < min(_with_changed_sensor(answers), default=np.inf):
        raise InputError("", text)


def _changes(pairs: int) -> Iterator[tuple[Array, str]]:
    """Changes (n_u, n_u) of the recorded voltages, and what they mean."""
    for k in range(pairs):
        columns = np.eye(pairs)
        columns[k, k] = -1.0
        name = f"u[{k + 1}]"
        yield columns, f"column '{name}' has the wrong sign, it seems; try --map '{name}={name}*-1'"
    for k, m in combinations(range(pairs), 2):
        columns = np.eye(pairs)
        columns[[k, m]] = columns[[m, k]]
        a, b = f"u[{k + 1}]", f"u[{m + 1}]"
        yield columns, f"columns '{a}' and '{b}' are exchanged, it seems; try --map '{a}={b}' --map '{b}={a}'"


def _with_changed_sensor(answers: StaticAnswers) -> Iterator[float]:
    """Mean misfits with one sensor's sign changed, or two sensors exchanged."""
    sensors = sorted(answers.measured)
    for s in sensors:
        yield _changed_total(answers, {s: -answers.measured[s]})
    for a, b in combinations(sensors, 2):
        yield _changed_total(answers, {a: answers.measured[b], b: answers.measured[a]})


def _changed_total(answers: StaticAnswers, measured: Mapping[int, Array]) -> float:
    changed = StaticAnswers(
        measured={**answers.measured, **measured},
        gains=answers.gains,
        directions=answers.directions,
        scale=answers.scale,
    )
    return changed.total(np.eye(answers.gains.shape[1]))


def _require_order(answers: StaticAnswers, sensors: Sequence[int], names: Sequence[str]) -> None:
    for a, b in combinations(sensors, 2):
        same_kind = names[a][:4] == names[b][:4]
        now = answers.misfit(a, a) + answers.misfit(b, b)
        swapped = answers.misfit(a, b) + answers.misfit(b, a)
        if same_kind and min(answers.misfit(a, a), answers.misfit(b, b)) > 0.5 and swapped < SWAPPED * now:
            raise exchanged(names[a], names[b], now / max(swapped, 1e-9))


def exchanged(first: str, second: str, better: float) -> InputError:
    """The refusal of two exchanged sensors."""
    return InputError(
        f"columns {first!r} and {second!r}",
        f"are exchanged, it seems: the structure explains them {better:.0f} times better the other way round; try "
        f"--map '{first}={second}' --map '{second}={first}'",
    )


def _wrong_unit(name: str, factor: float) -> InputError:
    return InputError(
        f"column {name!r}",
        f"is {abs(factor):.3g} times as large as the structure explains: wrong unit? (SI is expected: m, strain, V); "
        f"try --map '{name}={name}*{10.0 ** -round(np.log10(abs(factor))):g}'",
    )


def _require_sensor(answers: StaticAnswers, sensor: int, factor: float, name: str) -> None:
    if abs(factor) > FACTOR or abs(factor) < 1 / FACTOR:
        raise _wrong_unit(name, factor)
    if factor < -0.3 and answers.misfit(sensor, sensor) > 1.0:
        raise InputError(
            f"column {name!r}",
            f"has the wrong sign, it seems: it answers the voltages with {factor:.2g} times what the structure "
            f"explains; try --map '{name}={name}*-1'",
        )


def static_answers(experiments: Sequence[Experiment], gains: Array, period: float) -> StaticAnswers:
    """Mean answers to the directions of the mean voltages, measured by regression."""
    driven = [_means(e.voltages - e.rest, _window(e, period)) for e in experiments]
    _, sizes, directions = np.linalg.svd(np.linalg.qr(np.vstack(driven), mode="r"))
    directions = directions[: int(np.sum(sizes > 1e-3 * sizes[0]))] if sizes[0] > 0 else directions[:0]
    scale = sizes[: len(directions)] / sizes[0] if len(directions) else np.ones(0)
    measured: dict[int, Array] = {}
    for sensor in sorted({s for e in experiments for s in e.sensors}):
        rows, values = [], []
        for experiment, voltages in zip(experiments, driven, strict=True):
            if sensor in experiment.sensors:
                y = experiment.outputs[:, experiment.sensors.index(sensor)]
                rows.append(voltages @ directions.T)
                still = np.mean(y[: max(1, experiment.onset)])
                values.append(_means((y - still)[:, None], _window(experiment, period))[:, 0])
        measured[sensor] = np.linalg.lstsq(np.vstack(rows), np.concatenate(values), rcond=1e-6)[0] * scale
    return StaticAnswers(measured=measured, gains=gains, directions=directions, scale=scale)


def _window(experiment: Experiment, period: float) -> int:
    """Rows of a mean, at most half of the experiment's."""
    return max(1, min(round(AVERAGED * period / experiment.step), experiment.rows // 2))


def _means(values: Array, rows: int) -> Array:
    """Means over so many rows, from each row on (k, columns)."""
    sums = np.cumsum(np.vstack([np.zeros((1, values.shape[1])), values]), axis=0)
    return np.asarray((sums[rows:] - sums[:-rows]) / rows)


def require_size(experiment: Experiment, predicted: Array, names: Sequence[str]) -> None:
    """InputError for a sensor whose size is far from that of its prediction (rows, n_s), whatever the frequencies."""
    for k, sensor in enumerate(experiment.sensors):
        y = experiment.outputs[:, k] - np.mean(experiment.outputs[:, k])
        expected = float(np.std(predicted[:, k]))
        factor = float(np.sqrt(np.mean(y**2))) / max(expected, 1e-300)
        if factor > FACTOR or factor < 1 / FACTOR:
            raise _wrong_unit(names[sensor], factor)
