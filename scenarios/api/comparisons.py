"""Comparison of finished runs."""

from collections.abc import Mapping
from pathlib import Path

from flexbeams.scenarios.results.compare import Comparison
from flexbeams.scenarios.results.compare import compare as read_runs


def compare(
    *runs: str | Path, names: Mapping[str, str] | None = None, units: Mapping[str, str] | None = None
) -> Comparison:
    """Reads finished runs, or recordings of other tools, and compares their checks, metrics and signals.

    Parameters
    ----------
    runs
        Folders of results, such as results/tracking, or files *.csv, *.parquet, *.mat, *.mf4 with a column `time`.
    names
        Signals or arrays of such files, and what they are called in a run: {"y": "plant.y_pi"}.
    units
        Units of measurement of columns of such files that are not SI: {"y": "mm"}.

    Raises
    ------
    InputError
        For what cannot be read, and for runs that record no common signal.
    """
    return read_runs([Path(run) for run in runs], names, units)
