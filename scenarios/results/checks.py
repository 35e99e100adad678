"""Checks of a scenario: values measured on a recording and compared with their limits."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.plant.measures import decay_time, motion_settling_time, overshoots, settling_time
from flexbeams.scenarios.definition.declaration import element_names
from flexbeams.scenarios.definition.schema import Check, Scenario
from flexbeams.scenarios.definition.time_table import element_index
from flexbeams.scenarios.results.saturation import FLAG, SHARE
from flexbeams.scenarios.results.window import Window
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

    @property
    def limit(self) -> float | tuple[float, float | None] | None:
        """The largest value that holds, or the least and the largest; None without limits."""
        return self.maximum if self.minimum is None else (self.minimum, self.maximum)

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> "Outcome":
        """The outcome of an entry in summary.json; a value that JSON has not is NaN."""
        limit = record["limit"]
        minimum, maximum = limit if isinstance(limit, list) else (None, limit)
        value = float("nan") if record["value"] is None else float(record["value"])
        unit = str(record.get("unit") or "")
        return cls(
            name=record["name"], value=value, minimum=minimum, maximum=maximum, unit=unit, paper=record.get("paper")
        )

    def record(self) -> dict[str, Any]:
        """The entry in summary.json; limit is one number or [least, largest]."""
        limit = list(self.limit) if isinstance(self.limit, tuple) else self.limit
        return {
            "name": self.name,
            "value": self.value,
            "limit": limit,
            "unit": self.unit,
            "paper": self.paper,
            "passed": self.passed,
        }


def column_indices(columns: list[str], name: str) -> list[int]:
    """Indices of the columns of a recorded array, in the order of its elements' indices, or of one element."""
    places = {column: k for k, column in enumerate(columns)}
    return [places[element] for element in element_names(places, name)]


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
        window = self._window(self._recording, check, key)
        reference = self._reference(check, window, key)
        match check.measure:
            case "largest":
                value = float(window.largest(lambda time, y: np.max(np.abs(y - reference))))
            case "end_deviation":
                value = float(np.max(np.abs(window.end - reference)))
            case "largest_change":
                if len(window) < 2:
                    raise InputError(
                        f"{key}.after",
                        "must leave more than one row of the run to look at",
                        check.after,
                        source=self._source,
                    )
                value = window.largest_change()
            case "overshoot":
                value = float(np.max(window.largest(lambda time, y: overshoots(y, reference))))
            case "overshoot_percent":
                if check.reference not in ("end", "start") and not np.all(reference):
                    raise InputError(
                        f"{key}.reference",
                        "must not be zero for an overshoot in percent",
                        check.reference,
                        source=self._source,
                    )
                over = window.largest(lambda time, y: overshoots(y, reference))
                with np.errstate(divide="ignore", invalid="ignore"):
                    value = 100 * float(np.max(over / np.abs(reference)))
            case "settling_time" | "motion_settling_time":
                settling = settling_time if check.measure == "settling_time" else motion_settling_time
                value = float(window.largest(lambda time, y: settling(time, y, reference, check.after, check.share)))
            case "saturation_share":
                value = window.share(_is_set)
            case "open_loop_peak" | "decay_time" | "decay_ratio":
                value = self._against_open_loop(check, key, window)
        return value * self._factor(check, key) if check.relative else value

    def layout(self, check: Check, key: str = "check") -> tuple[Window, Array, float]:
        """The window that a check looks at, its reference (columns,), and a factor of the value for `relative`."""
        window = self._window(self._recording, check, key)
        return window, self._reference(check, window, key), self._factor(check, key) if check.relative else 1.0

    def _factor(self, check: Check, key: str) -> float:
        largest = float(np.max(np.abs(self._target(check, key))))
        if largest == 0:
            raise InputError(f"{key}.relative", "needs a target other than zero", source=self._source)
        return 100 / largest

    def _against_open_loop(self, check: Check, key: str, window: Window) -> float:
        """Decay to a fraction of the open loop's peak; a run without `open_loop` is compared with itself."""
        open_loop = self._window(self._open_loop or self._recording, check, key)
        before = open_loop.begin
        peak = float(open_loop.largest(lambda time, y: np.max(np.abs(y - before))))
        if check.measure == "open_loop_peak":
            return peak

        def decay(of: Window) -> float:
            rest = of.begin
            return float(of.largest(lambda time, y: decay_time(time, y, rest, check.after, peak, check.share)))

        own = decay(window)
        return own if check.measure == "decay_time" else decay(open_loop) / max(own, 1e-9)

    def _window(self, recording: Recording, check: Check, key: str) -> Window:
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
        window = Window.between(recording, columns, check.after, check.before)
        if not window:
            raise InputError(f"{key}.after", "must leave rows of the run to look at", check.after, source=self._source)
        return window

    def _reference(self, check: Check, window: Window, key: str) -> Array:
        count = len(window.columns)
        if isinstance(check.reference, list):
            if len(check.reference) not in (1, count):
                raise InputError(f"{key}.reference", f"must have {count} values", check.reference, source=self._source)
            return np.broadcast_to(np.asarray(check.reference, dtype=float), (count,))
        if check.reference == "target":
            return self._target(check, key)
        if check.reference == "end":
            return window.end
        return window.begin if check.reference == "start" else np.zeros(count)

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
            index = element_index(check.of)
            chosen = list(index) if len(index) == 1 else [len(value) + 1]
            elements = len(value)
        elif check.points:
            chosen = check.points
        if elements != len(value) or max(chosen) > len(value):
            raise InputError(
                f"{key}.of", f"must have the {len(value)} elements of the target", check.of, source=self._source
            )
        return value[[p - 1 for p in chosen]]


def standard_metrics(recording: Recording) -> dict[str, float]:
    """Metrics of every run: final deflections, the largest magnitude of each signal, shares of saturation."""
    end = recording.values[-1]
    largest = np.max([np.max(np.abs(values), axis=0) for _, values in recording.blocks()], axis=0)
    flags = [k for k, column in enumerate(recording.columns) if column.endswith(FLAG)]
    shares = {recording.columns[k]: Window.between(recording, [k], -np.inf, None).share(_is_set) for k in flags}
    metrics = {}
    for k, column in enumerate(recording.columns):
        if ".y_pi[" in column:
            metrics[f"{column}.end"] = float(end[k])
        metrics[f"{column}.largest"] = float(largest[k])
        if column in shares:
            metrics[column.removesuffix(FLAG) + SHARE] = shares[column]
    return metrics


def _is_set(flags: Array) -> Array:
    """Whether one of the flags (k, columns) is set in each row."""
    is_set: Array = np.any(flags != 0, axis=1)
    return is_set
