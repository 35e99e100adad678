"""Comparison of finished runs."""

from pathlib import Path

from flexbeams.scenarios.results.compare import Comparison
from flexbeams.scenarios.results.compare import compare as read_runs


def compare(*folders: str | Path) -> Comparison:
    """Reads finished runs and compares their checks, metrics and signals.

    Parameters
    ----------
    folders
        Folders of results, such as results/tracking.

    Raises
    ------
    InputError
        For a folder without results, and for runs that record no common signal.
    """
    return read_runs([Path(folder) for folder in folders])
