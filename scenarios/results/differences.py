"""Differences of the signals of runs on different time grids, and of their settings."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.results.compare import Comparison, FinishedRun
from flexbeams.scenarios.simulation.recording import Recording

LEAST_SHARE = 0.5  # of the longer recording that must be compared for a verdict that holds
_SAME_TIME = 1e-6  # of the shorter time between rows: times that differ by rounding only
_SETTINGS = ("scenario", "structure", "design_id", "coupling", "backend", "step", "stop_time", "decimate")


@dataclass(frozen=True, kw_only=True)
class SignalDifference:
    """How a signal of a run differs from that of the first run."""

    run: str  # label
    signal: str
    largest: float  # in the first run's unit of measurement, as rms
    rms: float
    relative: float  # largest by the largest magnitude in the first run
    time: float  # s, of the largest
    rows: int  # compared
    interpolated: int  # of these, where one of the runs has no row

    def record(self) -> dict[str, Any]:
        """Entry of the JSON output."""
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class ComparedSpan:
    """The times at which a run is compared with the first run."""

    run: str  # label
    begin: float  # s
    end: float  # s
    share: float  # of the time that the longer of the two recordings covers

    @property
    def text(self) -> str:
        """The times, as text."""
        return f"{self.begin:.6g} to {self.end:.6g} s"

    def record(self) -> dict[str, Any]:
        """Entry of the JSON output."""
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class CommonRows:
    """Two recordings at common times."""

    time: Array  # (rows,)
    first: Array  # (rows, columns)
    other: Array
    interpolated: int


def signal_differences(comparison: Comparison) -> list[SignalDifference]:
    """Every common signal of every further run against the first run, the largest relative difference first."""
    first, *others = comparison.runs
    found = []
    for run in others:
        rows = common_rows(first.recording, run.recording, comparison.signals)
        for k, signal in enumerate(comparison.signals):
            found.append(_difference(run.label, signal, rows, k))
    return sorted(found, key=lambda d: (-d.relative, d.run, d.signal))


def compared_spans(comparison: Comparison) -> list[ComparedSpan]:
    """The times at which each further run is compared with the first one."""
    first, *others = comparison.runs
    spans = []
    for run in others:
        time, _ = _common_times(first.recording, run.recording)
        longest = max(float(r.time[-1] - r.time[0]) for r in (first.recording, run.recording))
        begin, end = float(time[0]), float(time[-1])
        share = (end - begin) / longest if longest > 0 else 1.0
        spans.append(ComparedSpan(run=run.label, begin=begin, end=end, share=share))
    return spans


def within(tolerance: float | None, differences: Sequence[SignalDifference], spans: Sequence[ComparedSpan]) -> bool:
    """Whether runs agree: no relative difference above the tolerance, and no run compared for less than LEAST_SHARE.

    True without a tolerance.
    """
    if tolerance is None:
        return True
    return all(d.relative <= tolerance for d in differences) and all(s.share >= LEAST_SHARE for s in spans)


def _difference(label: str, signal: str, rows: CommonRows, k: int) -> SignalDifference:
    gap = np.abs(rows.other[:, k] - rows.first[:, k])
    row = int(np.argmax(np.where(np.isnan(gap), np.inf, gap)))
    largest, peak = float(gap[row]), float(np.max(np.abs(rows.first[:, k])))
    if largest == 0:
        relative = 0.0
    else:
        relative = largest / peak if peak > 0 and np.isfinite(largest) else float("inf")
    return SignalDifference(
        run=label,
        signal=signal,
        largest=largest,
        rms=float(np.sqrt(np.mean(gap**2))),
        relative=relative,
        time=float(rows.time[row]),
        rows=len(rows.time),
        interpolated=rows.interpolated,
    )


def common_rows(first: Recording, other: Recording, signals: list[str]) -> CommonRows:
    """Both recordings at the times of the coarser one where they overlap.

    Rows whose times differ by rounding are taken as they are; between rows of the finer one values are interpolated
    linearly.
    """
    time, slack = _common_times(first, other)
    placed, interpolated = [], 0
    for recording in (first, other):
        values = recording.values[:, [recording.columns.index(s) for s in signals]]
        after = np.clip(np.searchsorted(recording.time, time), 1, len(recording.time) - 1)
        nearest = after - (time - recording.time[after - 1] < recording.time[after] - time)
        rows = values[nearest]
        between = np.flatnonzero(np.abs(recording.time[nearest] - time) > slack)
        for k in range(values.shape[1]):
            rows[between, k] = np.interp(time[between], recording.time, values[:, k])
        placed.append(rows)
        interpolated = max(interpolated, len(between))
    return CommonRows(time=time, first=placed[0], other=placed[1], interpolated=interpolated)


def _common_times(first: Recording, other: Recording) -> tuple[Array, float]:
    """The times of the coarser recording where both overlap, and by how much equal times may differ, s."""
    begin, end = max(first.time[0], other.time[0]), min(first.time[-1], other.time[-1])
    slack = _SAME_TIME * min(np.diff(first.time).min(initial=np.inf), np.diff(other.time).min(initial=np.inf))

    def inside(recording: Recording) -> Array:
        chosen: Array = recording.time[(recording.time >= begin - slack) & (recording.time <= end + slack)]
        return chosen

    time = min(inside(other), inside(first), key=len)
    if not len(time):
        raise InputError("RUN", f"must overlap in time: they are of {_span(first)} and {_span(other)}")
    return time, float(slack)


def _span(recording: Recording) -> str:
    return f"{recording.time[0]:g} to {recording.time[-1]:g} s"


def setting_differences(comparison: Comparison) -> list[tuple[str, list[str]]]:
    """Settings that are not equal in all runs, each with its value in every run; files of other tools have none."""
    rows = []
    tables = [_settings(run) for run in comparison.runs]
    for name in dict.fromkeys(name for table in tables for name in table):
        cells = [table.get(name, "") for table in tables]
        known = [c for c, run in zip(cells, comparison.runs, strict=True) if run.summary]
        if len(set(known)) > 1:
            rows.append((name, cells))
    return rows


def _settings(run: FinishedRun) -> dict[str, str]:
    summary = run.summary
    table = {name: str(summary[name]) for name in _SETTINGS if name in summary}
    changed = summary.get("settings", {})
    table |= {name: str(value) for name, value in changed.items() if name not in (*table, "set")}
    return table | {name: str(value) for name, value in summary.get("set", {}).items()}
