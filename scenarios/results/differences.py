"""Differences of the signals of runs on different time grids, and of their settings."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.results.compare import Comparison, FinishedRun, figure_signals
from flexbeams.scenarios.results.decimation import Thinning
from flexbeams.scenarios.simulation.recording import BLOCK_BYTES, Recording

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
    longest: float  # s, that the longer of the two recordings covers

    @property
    def share(self) -> float:
        """The part of that time which is compared."""
        return (self.end - self.begin) / self.longest if self.longest > 0 else 1.0

    @property
    def text(self) -> str:
        """The times, as text."""
        return f"{self.begin:.6g} to {self.end:.6g} s"

    def record(self) -> dict[str, Any]:
        """Entry of the JSON output."""
        return {"run": self.run, "begin": self.begin, "end": self.end, "share": self.share}


@dataclass(frozen=True, kw_only=True)
class CommonRows:
    """Two recordings at common times."""

    time: Array  # (rows,)
    first: Array  # (rows, columns)
    other: Array
    interpolated: int


@dataclass(frozen=True, kw_only=True)
class RunDifference:
    """How a run differs from the first one."""

    label: str
    signals: list[SignalDifference]
    span: ComparedSpan
    gaps: Recording  # differences of the signals of `figure_arrays` at the common times, in memory, as they are drawn


def run_differences(comparison: Comparison) -> list[RunDifference]:
    """Every further run against the first one; its rows are read once."""
    first, *others = comparison.runs
    signals, drawn = comparison.signals, figure_signals(comparison)
    chosen = [signals.index(name) for name in drawn]
    found = []
    for run in others:
        common = _common_times(first.recording, run.recording)
        total, thinning = _Total(len(signals)), Thinning(common.stop - common.first, len(drawn))
        for rows in _common_rows(first.recording, run.recording, signals, common):
            gap = rows.other - rows.first
            total.add(rows, gap)
            thinning.add(rows.time, gap[:, chosen])
        time, values = thinning.taken()
        found.append(
            RunDifference(
                label=run.label,
                signals=[total.difference(run.label, signal, k) for k, signal in enumerate(signals)],
                span=_compared_span(run.label, common, first.recording, run.recording),
                gaps=Recording(time=time, columns=drawn, values=values, wall_seconds=float("nan")),
            )
        )
    return found


def signal_differences(differences: Sequence[RunDifference]) -> list[SignalDifference]:
    """Every common signal of every further run against the first run, the largest relative difference first."""
    found = [signal for difference in differences for signal in difference.signals]
    return sorted(found, key=lambda d: (-d.relative, d.run, d.signal))


def _compared_span(label: str, common: "_CommonTimes", first: Recording, other: Recording) -> ComparedSpan:
    longest = max(float(r.time[-1] - r.time[0]) for r in (first, other))
    begin, end = (float(common.coarser.time[row]) for row in (common.first, common.stop - 1))
    return ComparedSpan(run=label, begin=begin, end=end, longest=longest)


def within(tolerance: float | None, differences: Sequence[SignalDifference], spans: Sequence[ComparedSpan]) -> bool:
    """Whether runs agree: no relative difference above the tolerance, and no run compared for less than LEAST_SHARE.

    True without a tolerance.
    """
    if tolerance is None:
        return True
    return all(d.relative <= tolerance for d in differences) and all(s.share >= LEAST_SHARE for s in spans)


class _Total:
    """Differences of the columns of rows that follow each other."""

    def __init__(self, columns: int) -> None:
        self._largest, self._time = np.full(columns, -1.0), np.zeros(columns)  # NaN counts as infinite
        self._squares, self._peak = np.zeros(columns), np.zeros(columns)
        self._rows = self._interpolated = 0

    def add(self, rows: CommonRows, gap: Array) -> None:
        """Counts further rows and their differences (rows, columns)."""
        for k in np.flatnonzero(~(_magnitude(gap) <= self._largest)):  # also where it is NaN
            size = np.abs(gap[:, k])
            size[np.isnan(size)] = np.inf
            row = np.argmax(size)
            if size[row] > self._largest[k]:
                self._largest[k], self._time[k] = size[row], rows.time[row]
        self._squares += np.einsum("ij,ij->j", gap, gap)
        self._peak = np.maximum(self._peak, _magnitude(rows.first))
        self._rows += len(rows.time)
        self._interpolated += rows.interpolated

    def difference(self, label: str, signal: str, k: int) -> SignalDifference:
        """The difference of column k."""
        largest, peak = float(self._largest[k]), float(self._peak[k])
        if largest == 0:
            relative = 0.0
        else:
            relative = largest / peak if peak > 0 and np.isfinite(largest) else float("inf")
        return SignalDifference(
            run=label,
            signal=signal,
            largest=largest,
            rms=float(np.sqrt(self._squares[k] / self._rows)),
            relative=relative,
            time=float(self._time[k]),
            rows=self._rows,
            interpolated=self._interpolated,
        )


def _magnitude(values: Array) -> Array:
    """The largest magnitude of each column (columns,), NaN for one that contains NaN."""
    largest: Array = np.maximum(values.max(axis=0), -values.min(axis=0))
    return largest


def _common_rows(
    first: Recording, other: Recording, signals: list[str], common: "_CommonTimes"
) -> Iterator[CommonRows]:
    """Both recordings at their common times, in blocks where one of them is in a file.

    Rows whose times differ by rounding are taken as they are; between rows of the finer one values are interpolated
    linearly.
    """
    columns = [_selection(recording, signals) for recording in (first, other)]
    for time in common.blocks():
        (one, between), (two, others_between) = (
            _placed(recording, time, chosen, common.slack)
            for recording, chosen in zip((first, other), columns, strict=True)
        )
        yield CommonRows(time=time, first=one, other=two, interpolated=max(between, others_between))


def _selection(recording: Recording, signals: list[str]) -> list[int] | slice:
    """Columns of signals in this order; all of them as a slice, which copies nothing."""
    columns = [recording.columns.index(signal) for signal in signals]
    return slice(None) if columns == list(range(len(recording.columns))) else columns


def _placed(recording: Recording, time: Array, columns: list[int] | slice, slack: float) -> tuple[Array, int]:
    """Some columns of a recording at other times (rows, columns), and how many of the rows are interpolated."""
    count = len(recording.time)
    begin = min(recording.rows_before(time[0] - slack), count - 1)
    end = recording.rows_before(time[-1] + slack, equal=True)
    times, parts = zip(*recording.blocks(max(begin - 1, 0), min(end + 1, count)), strict=True)
    own, values = _joined(times), _joined([part[:, columns] for part in parts])
    if len(own) == 1:
        return np.repeat(values, len(time), axis=0), 0
    after = np.clip(np.searchsorted(own, time), 1, len(own) - 1)
    nearest = after - (time - own[after - 1] < own[after] - time)
    begin, end = int(nearest[0]), int(nearest[0]) + len(time)
    if end <= len(own) and np.abs(own[begin:end] - time).max() <= slack:  # row by row, the usual case
        return values[begin:end], 0
    rows = values[nearest]
    between = np.flatnonzero(np.abs(own[nearest] - time) > slack)
    for k in range(values.shape[1]):
        rows[between, k] = np.interp(time[between], own, values[:, k])
    return rows, len(between)


def _joined(parts: Sequence[Array]) -> Array:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


@dataclass(frozen=True, kw_only=True)
class _CommonTimes:
    """The rows first ... stop - 1 of the coarser recording, where both overlap."""

    coarser: Recording
    first: int
    stop: int
    slack: float  # s, by which equal times may differ
    parts: int

    def blocks(self) -> Iterator[Array]:
        """The times, in parts that need little memory."""
        ends = np.linspace(self.first, self.stop, min(self.parts, self.stop - self.first) + 1).astype(int)
        for begin, end in pairwise(ends):
            yield _joined([time for time, _ in self.coarser.blocks(int(begin), int(end))])


def _common_times(first: Recording, other: Recording) -> _CommonTimes:
    begin, end = max(first.time[0], other.time[0]), min(first.time[-1], other.time[-1])
    slack = _SAME_TIME * min(_least_interval(first), _least_interval(other))

    def inside(recording: Recording) -> tuple[int, int]:
        return recording.rows_before(begin - slack), recording.rows_before(end + slack, equal=True)

    spans = [(recording, *inside(recording)) for recording in (other, first)]
    coarser, start, stop = min(spans, key=lambda span: span[2] - span[1])
    if stop <= start:
        raise InputError("RUN", f"must overlap in time: they are of {_span(first)} and {_span(other)}")
    sizes = [8 * (1 + len(r.columns)) * (b - a) for r, a, b in spans if first.file or other.file]
    parts = -(-max(sizes, default=1) // BLOCK_BYTES)
    return _CommonTimes(coarser=coarser, first=start, stop=stop, slack=float(slack), parts=parts)


def _least_interval(recording: Recording) -> float:
    """The shortest time between two rows, s; infinite for one row."""
    if recording.file is not None:
        return recording.file.least_interval
    return float(np.diff(recording.time).min(initial=np.inf))


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
