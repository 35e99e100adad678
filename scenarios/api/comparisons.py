"""Comparison of finished runs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.arguments import require_number
from flexbeams.scenarios.results.compare import Comparison as ComparedRuns
from flexbeams.scenarios.results.compare import compare as read_runs
from flexbeams.scenarios.results.differences import (
    ComparedSpan,
    RunDifference,
    SignalDifference,
    run_differences,
    setting_differences,
    signal_differences,
    within,
)
from flexbeams.scenarios.runs.observer import ignore_note
from flexbeams.scenarios.runs.run_view import RunView, framed


@dataclass(frozen=True, kw_only=True, repr=False)
class Comparison(ComparedRuns):
    """Runs with signals in common; the first is the reference.

    Attributes
    ----------
    tolerance
        Largest difference that holds, relative to the largest value of a signal in the first run.
    """

    tolerance: float | None = None

    @cached_property
    def by_run(self) -> list[RunDifference]:
        """How each further run differs from the first."""
        return run_differences(self)

    @cached_property
    def differences(self) -> list[SignalDifference]:
        """Every common signal of every further run against the first, the largest relative difference first."""
        return signal_differences(self.by_run)

    @property
    def spans(self) -> list[ComparedSpan]:
        """The times at which each further run is compared with the first."""
        return [difference.span for difference in self.by_run]

    @cached_property
    def settings(self) -> dict[str, list[str]]:
        """Settings that are not equal in all runs, each with its value in every run."""
        return dict(setting_differences(self))

    @property
    def holds(self) -> bool:
        """Whether no signal differs by more than the tolerance, over half of the longer run at least.

        True without a tolerance.
        """
        return within(self.tolerance, self.differences, self.spans)

    def __repr__(self) -> str:
        labels = " and ".join(run.label for run in self.runs)
        lines = [f"{labels}: {len(self.signals)} common signals"]
        lines += [f"  {d.signal}: {d.relative:.3g} of the largest value, at {d.time:g} s" for d in self.differences[:5]]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """The page of `flexbeams compare` in a frame of its own."""
        from flexbeams.scenarios.report.comparison import comparison_html

        title = " and ".join(run.label for run in self.runs)
        return framed(comparison_html(self, title, self.by_run), title)


def compare(
    *runs: str | Path | RunView,
    tolerance: float | None = None,
    names: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    notify: Callable[[str], None] = ignore_note,
) -> Comparison:
    """Compares the checks, metrics and signals of finished runs and of recordings of other tools.

    Parameters
    ----------
    runs
        Runs, folders of results, such as results/tracking, or files *.csv, *.parquet, *.mat, *.mf4 with a column
        `time`. The first is the reference.
    tolerance
        Largest difference of a signal that holds, relative to its largest value in the first run: see `holds`.
    names
        Signals or arrays of such files, and what they are called in a run: {"y": "plant.y_pi"}.
    units
        Units of measurement of columns of such files that are not SI: {"y": "mm"}.
    notify
        Called with notes, such as the names of columns that are no numbers.

    Raises
    ------
    InputError
        For what cannot be read, and for runs that record no common signal.

    Examples
    --------
    >>> import flexbeams as fb
    >>> runs = [fb.run("single_beam", stop_time=1.5, coupling=c) for c in ("jacobi", "gauss-seidel")]
    >>> comparison = fb.compare(*runs, tolerance=1e-9)
    >>> comparison.holds, comparison.settings
    (False, {'coupling': ['jacobi', 'gauss-seidel']})
    """
    require_number("tolerance", tolerance)
    if tolerance is not None and not tolerance > 0:
        raise InputError("tolerance", "must be > 0", tolerance)
    read = read_runs([r.as_finished() if isinstance(r, RunView) else Path(r) for r in runs], names, units, notify)
    return Comparison(**{f.name: getattr(read, f.name) for f in fields(read)}, tolerance=tolerance)
