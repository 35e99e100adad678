"""Voltages that determine the parameters best: segments of steps and sweeps, chosen by their Fisher information.

A record starts at rest and consists of segments of equal length, in each of which every patch pair follows a share
(LEVELS) of the voltage limit times a signal: held, or a sine sweep. Outputs are linear in the voltages, and so are
their derivatives: those of a record are sums of the responses to single pairs, shifted to their segments. The latter
are computed once; the information of any record then costs one matrix product. Coordinates are exchanged one by one
(Meyer and Nachtsheim 1995) until no exchange improves the criterion. A record whose deflections would exceed their
limit counts, and is recorded, with all its voltages smaller by one factor.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.sensitivity import drive_of, modal_system, predict
from flexbeams.plant.identification.space import ParameterSpace
from flexbeams.plant.statespace import undamped_frequencies

Criterion = Literal["D", "A"]
LEVELS = (-1.0, -0.5, 0.0, 0.5, 1.0)  # of the limit
RESTING = 0.2  # s before the first segment
ROWS = 900  # of the information that guides the search
TRIALS = 2  # random starts of the exchange, besides the simple records
PASSES = 20  # at most, over all coordinates
BETTER = 1e-6  # of the criterion, that an exchange must gain
PERIODS = 10  # of the slowest mode that a segment lasts by default
BELOW, ABOVE = 0.5, 1.2  # a sweep runs from so many times the first frequency to so many times its last one


@dataclass(frozen=True, kw_only=True)
class Segment:
    """One segment: what the pairs follow, and by how much."""

    signal: str  # "step", or "sweep to ... Hz"
    voltages: tuple[float, ...]  # V


@dataclass(frozen=True, kw_only=True)
class Candidates:
    """Signals that a segment may have: held, and sine sweeps."""

    rows: int  # of a segment
    step: float  # s
    names: tuple[str, ...]
    values: Array  # (signals, rows), -1 ... 1


def candidates(
    model: BeamModel, space: ParameterSpace, *, duration: float | None, step: float, sweeps: bool, steps: bool
) -> Candidates:
    """The signals for segments of `duration` s, by default PERIODS of the slowest mode.

    Sweeps are linear and run over the first r and the first 3 r modes of r beams, as far as `step` s has ten samples a
    period.
    """
    frequencies = undamped_frequencies(model.assemble(space.values(np.zeros(len(space.names))))) / (2 * np.pi)
    beams = len(model.structure.beam)
    length = duration or np.ceil(2 * PERIODS / frequencies[0]) / 2
    rows = max(1, round(length / step))
    tau, whole = step * np.arange(rows), rows * step
    names, values = [], []
    if steps:
        names, values = ["step"], [np.ones(rows)]
    first = BELOW * frequencies[0]
    for last in sorted({frequencies[min(k, len(frequencies)) - 1] for k in (beams, 3 * beams)}) if sweeps else ():
        top = min(ABOVE * last, 0.1 / step)
        names.append(f"sweep to {top:.3g} Hz")
        values.append(np.sin(2 * np.pi * (first * tau + (top - first) * tau**2 / (2 * whole))))
    return Candidates(rows=rows, step=step, names=tuple(names), values=np.array(values))


@dataclass
class SearchRecord:
    """A record in the search, and its thinned responses, which change with it."""

    kinds: NDArray[np.intp]  # (segments,): signal of each
    levels: Array  # (segments, n_u)
    columns: Array  # (p, n_s, rows): weighted derivatives
    deflections: Array  # (n_pi, rows), m


class Search:
    """Exchange of the coordinates of a record of `count` segments.

    `deviations` (n_all,) are those of the sensors' noise, `limit` is in V, `deflection_limit` in m. `progress` receives
    trials done and in all.
    """

    def __init__(
        self,
        model: BeamModel,
        space: ParameterSpace,
        signals: Candidates,
        count: int,
        *,
        deviations: Array,
        limit: float,
        deflection_limit: float,
        criterion: Criterion = "D",
    ) -> None:
        self.signals, self.count, self.criterion, self.limit = signals, count, criterion, limit
        self._deflection_limit = deflection_limit
        self._prior = np.diag(1 / space.deviation**2)
        self._pairs = len(model.structure.patch)
        self._stride = max(1, -(-count * signals.rows // ROWS))
        self._shift = -(-signals.rows // self._stride)
        self._unit, self._deflections = self._responses(model, space, deviations)

    def simple(self) -> dict[str, list[Segment]]:
        """What one would record without a plan: all pairs together to and fro, and one pair after another."""
        name = self.signals.names[0]
        signs, one = np.resize([1.0, -1.0], self.count), np.resize(np.eye(self._pairs), (self.count, self._pairs))
        return {
            f"a {name} of all pairs together": self.segments_of(
                [0] * self.count, np.outer(signs, np.ones(self._pairs))
            ),
            f"a {name} of one pair after another": self.segments_of([0] * self.count, one),
        }

    def trials(
        self, seed: int = 0, progress: Callable[[int, int], None] = lambda done, most: None
    ) -> list[list[Segment]]:
        """The records at which exchanges end that start from the simple records and from TRIALS random ones."""
        rng = np.random.default_rng(seed)
        starts = [self._levels(segments) for segments in self.simple().values()]
        for _ in range(TRIALS):
            kinds = rng.integers(len(self.signals.names), size=self.count)
            starts.append((kinds, rng.choice([-1.0, 1.0], size=(self.count, self._pairs))))
        found = []
        for done, (kinds, levels) in enumerate(starts):
            progress(done, len(starts))
            found.append(self.segments_of(*self._exchanged(kinds, levels)))
        progress(len(starts), len(starts))
        return found

    def record_of(self, kinds: NDArray[np.intp], levels: Array) -> SearchRecord:
        """The responses of a record."""
        state = SearchRecord(
            kinds=kinds.copy(),
            levels=levels.copy(),
            columns=np.zeros(self._unit.shape[2:]),
            deflections=np.zeros(self._deflections.shape[2:]),
        )
        for k in range(self.count):
            self._add(state, k, kinds[k], levels[k])
        return state

    def size(self, data: Array) -> float:
        """Mean deviation that an information (p, p) of the data leaves, relative: geometric over the directions of
        parameter space (D), or root mean square over the parameters (A)."""
        return float(np.exp(-self._value(data)))

    def segments_of(self, kinds: Sequence[int] | NDArray[np.intp], levels: Array) -> list[Segment]:
        """The segments of signals (count,) and levels (count, n_u)."""
        return [
            Segment(signal=self.signals.names[kind], voltages=tuple(float(self.limit * level) for level in row))
            for kind, row in zip(kinds, levels, strict=True)
        ]

    def _levels(self, segments: Sequence[Segment]) -> tuple[NDArray[np.intp], Array]:
        kinds = np.array([self.signals.names.index(segment.signal) for segment in segments])
        return kinds, np.array([segment.voltages for segment in segments]) / self.limit

    def _responses(self, model: BeamModel, space: ParameterSpace, deviations: Array) -> tuple[Array, Array]:
        """Weighted derivatives (signals, pairs, p, n_s, thinned rows) for each pair alone in the first segment, and
        the points' deflections (signals, pairs, n_pi, thinned rows)."""
        x = np.zeros(len(space.names))
        form, derivatives = modal_system(model, space.values(x), list(space.names))
        slopes, sensors, points = space.slopes(x), len(deviations), len(model.deflection)
        thinned, rows = self.count * self._shift, self.count * self._shift * self._stride
        unit = np.empty((len(self.signals.names), self._pairs, len(x), sensors, thinned))
        deflections = np.empty((len(self.signals.names), self._pairs, points, thinned))
        for s, signal in enumerate(self.signals.values):
            for pair in range(self._pairs):
                voltages = np.zeros((rows, self._pairs))
                voltages[: len(signal), pair] = self.limit * signal
                drive = drive_of(_silent(voltages, self.signals.step, sensors), model)
                prediction = predict(form, derivatives, drive, stride=self._stride)
                unit[s, pair] = prediction.parameters * slopes[:, None, None] / deviations[:, None]
                deflections[s, pair] = prediction.outputs[:points]
        return unit, deflections

    def _exchanged(self, kinds: NDArray[np.intp], levels: Array) -> tuple[NDArray[np.intp], Array]:
        """Signals (count,) and levels (count, n_u) that no exchange of one coordinate improves."""
        state = self.record_of(kinds, levels)
        best = self.value_of(state)
        for _ in range(PASSES):
            before = best
            for k in range(self.count):
                for kind, row in self._neighbours(state.kinds[k], state.levels[k]):
                    trial = replace(
                        state,
                        kinds=state.kinds.copy(),
                        levels=state.levels.copy(),
                        columns=state.columns.copy(),
                        deflections=state.deflections.copy(),
                    )
                    self._add(trial, k, state.kinds[k], -state.levels[k])
                    self._add(trial, k, kind, row)
                    trial.kinds[k], trial.levels[k] = kind, row
                    value = self.value_of(trial)
                    if value > best + BETTER:
                        best, state = value, trial
            if best <= before + BETTER:
                break
        return state.kinds, state.levels

    def _neighbours(self, kind: int, row: Array) -> list[tuple[int, Array]]:
        """Signals and levels of a segment with one coordinate changed."""
        found = [(other, row) for other in range(len(self.signals.names)) if other != kind]
        for pair in range(self._pairs):
            for level in LEVELS:
                if level != row[pair]:
                    changed = row.copy()
                    changed[pair] = level
                    found.append((kind, changed))
        return found

    def _add(self, state: SearchRecord, segment: int, kind: int, levels: Array) -> None:
        """Adds the responses to one segment."""
        first, moved = segment * self._shift, np.flatnonzero(levels)
        for total, unit in ((state.columns, self._unit), (state.deflections, self._deflections)):
            own = np.tensordot(levels[moved], unit[kind, moved], axes=1)
            total[..., first:] += own[..., : total.shape[-1] - first]

    def value_of(self, state: SearchRecord) -> float:
        """The criterion by thinned rows, larger is better; deflections beyond their limit make all voltages smaller."""
        flat = state.columns.reshape(len(state.columns), -1)
        share = min(1.0, self._deflection_limit / max(float(np.max(np.abs(state.deflections))), 1e-300))
        return self._value(share**2 * self._stride * (flat @ flat.T))

    def _value(self, data: Array) -> float:
        """The criterion, larger is better: minus the logarithm of a mean deviation."""
        information = data + self._prior
        if self.criterion == "D":
            return float(np.linalg.slogdet(information)[1]) / (2 * len(information))
        return -0.5 * float(np.log(np.mean(np.diag(np.linalg.inv(information)))))


def record(
    model: BeamModel, space: ParameterSpace, segments: Sequence[Segment], signals: Candidates, deflection_limit: float
) -> tuple[list[Segment], Experiment]:
    """The segments and their record, from rest, as the model predicts it; all voltages are smaller by one factor where
    deflections would exceed `deflection_limit` m."""
    still = np.zeros((1, len(model.structure.patch)))
    driven = [np.outer(signals.values[signals.names.index(s.signal)], s.voltages) for s in segments]
    voltages = np.vstack([np.repeat(still, round(RESTING / signals.step), axis=0), *driven, still])
    form, _ = modal_system(model, space.values(np.zeros(len(space.names))), [])
    silent = _silent(voltages, signals.step, len(model.deflection) + len(model.strain))
    outputs = predict(form, [], drive_of(silent, model)).outputs.T
    largest = float(np.max(np.abs(outputs[:, : len(model.deflection)])))
    share = min(1.0, deflection_limit / largest) if largest > 0 else 1.0
    scaled = [replace(s, voltages=tuple(share * voltage for voltage in s.voltages)) for s in segments]
    return scaled, replace(silent, voltages=share * voltages, outputs=share * outputs)


def _silent(voltages: Array, step: float, sensors: int) -> Experiment:
    """An experiment without outputs."""
    return Experiment(
        name="plan",
        step=step,
        voltages=voltages,
        outputs=np.zeros((len(voltages), sensors)),
        sensors=tuple(range(sensors)),
    )
