"""Checks of a scenario: values measured on a recording and compared with their limits."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.plant.measures import decay_time, motion_settling_time, overshoots, settling_time
from flexbeams.scenarios.definition.schema import Check, Scenario
from flexbeams.scenarios.simulation.recording import Recording


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A check with its measured value; without limits it only reports."""

    name: str
    value: float
    minimum: float | None
    maximum: float | None
    unit: str
    paper: float | str | None

    @property
    def passed(self) -> bool:
        """Within the limits; NaN fails."""
        low = -np.inf if self.minimum is None else self.minimum
        high = np.inf if self.maximum is None else self.maximum
        return bool(low <= self.value <= high)

    def record(self) -> dict[str, Any]:
        """The entry in summary.json; limit is one number or [least, largest]."""
        limit = self.maximum if self.minimum is None else [self.minimum, self.maximum]
        return {
            "name": self.name,
            "value": self.value,
            "limit": limit,
            "unit": self.unit,
            "paper": self.paper,
            "passed": self.passed,
        }


def column_indices(columns: list[str], name: str) -> list[int]:
    """Indices of the columns of a recorded array or element."""
    return [k for k, c in enumerate(columns) if c == name or c.startswith(f"{name}[")]


class Measurement:
    """Measures a scenario's checks on its recording, and on that of the open loop where it names one."""

    def __init__(self, scenario: Scenario, source: str, recording: Recording, open_loop: Recording | None) -> None:
        self._scenario, self._source = scenario, source
        self._recording, self._open_loop = recording, open_loop

    def outcomes(self) -> list[Outcome]:
        """Every check of the scenario."""
        return [
            Outcome(
                name=check.name,
                value=self.value(check, f"check[{k}]"),
                minimum=check.min,
                maximum=check.max,
                unit=check.unit,
                paper=check.paper,
            )
            for k, check in enumerate(self._scenario.check, 1)
        ]

    def value(self, check: Check, key: str) -> float:
        """The value of one check, in SI units, seconds or percent."""
        time, y = self._window(self._recording, check, key)
        reference = self._reference(check, y, key)
        match check.measure:
            case "largest":
                value = float(np.max(np.abs(y - reference)))
            case "end_deviation":
                value = float(np.max(np.abs(y[-1] - reference)))
            case "largest_change":
                if len(y) < 2:
                    raise InputError(
                        f"{key}.after",
                        "must leave more than one row of the run to look at",
                        check.after,
                        source=self._source,
                    )
                value = float(np.max(np.abs(np.diff(y, axis=0))))
            case "overshoot":
                value = float(np.max(overshoots(y, reference)))
            case "overshoot_percent":
                if check.reference not in ("end", "start") and not np.all(reference):
                    raise InputError(
                        f"{key}.reference",
                        "must not be zero for an overshoot in percent",
                        check.reference,
                        source=self._source,
                    )
                with np.errstate(divide="ignore", invalid="ignore"):
                    value = 100 * float(np.max(overshoots(y, reference) / np.abs(reference)))
            case "settling_time":
                value = settling_time(time, y, reference, check.after, check.share)
            case "motion_settling_time":
                value = motion_settling_time(time, y, reference, check.after, check.share)
            case "open_loop_peak" | "decay_time" | "decay_ratio":
                value = self._against_open_loop(check, key, time, y)
        if not check.relative:
            return value
        largest = float(np.max(np.abs(self._target(check, key))))
        if largest == 0:
            raise InputError(f"{key}.relative", "needs a target other than zero", source=self._source)
        return 100 * value / largest

    def _against_open_loop(self, check: Check, key: str, time: Array, y: Array) -> float:
        """Decay to a fraction of the open loop's peak; a run without `open_loop` is compared with itself."""
        open_time, open_y = self._window(self._open_loop or self._recording, check, key)
        peak = float(np.max(np.abs(open_y - open_y[0])))
        if check.measure == "open_loop_peak":
            return peak
        own = decay_time(time, y, y[0], check.after, peak, check.share)
        if check.measure == "decay_time":
            return own
        return decay_time(open_time, open_y, open_y[0], check.after, peak, check.share) / max(own, 1e-9)

    def _window(self, recording: Recording, check: Check, key: str) -> tuple[Array, Array]:
        columns = column_indices(recording.columns, check.of)
        if not columns:
            known = dict.fromkeys(c.split("[")[0] for c in recording.columns)
            raise InputError(
                f"{key}.of", "is not recorded" + suggestion(check.of, known), check.of, source=self._source
            )
        if check.points:
            if max(check.points) > len(columns):
                raise InputError(
                    f"{key}.points", f"must be from 1 to {len(columns)}", check.points, source=self._source
                )
            columns = [columns[p - 1] for p in check.points]
        last = recording.time[-1] if check.before is None else check.before
        rows = (recording.time >= check.after - 1e-9) & (recording.time <= last + 1e-9)
        if not rows.any():
            raise InputError(f"{key}.after", "must leave rows of the run to look at", check.after, source=self._source)
        return recording.time[rows], recording.values[rows][:, columns]

    def _reference(self, check: Check, y: Array, key: str) -> Array:
        if isinstance(check.reference, list):
            if len(check.reference) not in (1, y.shape[1]):
                raise InputError(
                    f"{key}.reference", f"must have {y.shape[1]} values", check.reference, source=self._source
                )
            return np.broadcast_to(np.asarray(check.reference, dtype=float), y.shape[1:])
        if check.reference == "target":
            return self._target(check, key)
        rows = {"end": y[-1], "start": y[0]}
        return np.asarray(rows.get(check.reference, np.zeros(y.shape[1])))

    def _target(self, check: Check, key: str) -> Array:
        """The target in force at the end of the window, for the selected points."""
        lists = [i.targets for i in self._scenario.input if i.targets]
        if not lists:
            raise InputError(f"{key}.reference", "needs an input with targets", source=self._source)
        last = self._recording.time[-1] if check.before is None else check.before
        reached = [t for t in lists[0] if t.time <= last - 1e-9]
        value = np.array(reached[-1].value) if reached else np.zeros(len(lists[0][0].value))
        elements = len(column_indices(self._recording.columns, check.of))
        chosen = list(range(1, elements + 1))
        if check.of.endswith("]"):
            chosen = [int(check.of[check.of.rindex("[") + 1 : -1])]
            elements = len(value)
        elif check.points:
            chosen = check.points
        if elements != len(value) or max(chosen) > len(value):
            raise InputError(
                f"{key}.of", f"must have the {len(value)} elements of the target", check.of, source=self._source
            )
        return value[[p - 1 for p in chosen]]


def standard_metrics(recording: Recording) -> dict[str, float]:
    """Metrics of every run: final deflections and the largest magnitude of each signal."""
    metrics = {}
    for k, column in enumerate(recording.columns):
        values = recording.values[:, k]
        if ".y_pi[" in column:
            metrics[f"{column}.end"] = float(values[-1])
        metrics[f"{column}.largest"] = float(np.max(np.abs(values)))
    return metrics
