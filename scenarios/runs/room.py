"""Room for a recording: what its rows and result files take on disk and in memory."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from tempfile import gettempdir

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.choices import Format
from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.simulation.wiring import Wiring

MAX_BYTES_IN_MEMORY = 2**26  # of recorded values; those of a longer recording are in a file while the run steps
MAX_BYTES_TOGETHER = 2**30  # of recorded values that are in memory: of a simulation step by step, and for a MAT file
_SHARES: dict[Format, float] = {"csv": 2.6, "parquet": 1.2, "mf4": 1.1, "mat": 1.0}  # of a file, at most, in 8 bytes


def recorded_bytes(columns: int, steps: int, decimate: int) -> int:
    """Size of the values of so many columns and their times."""
    return 8 * (columns + 1) * (-(-steps // decimate) + 1)


def with_affordable_deflections(wiring: Wiring, steps: int, decimate: int) -> Wiring:
    """The wiring, which records deflections beside its columns only where all of them stay in memory."""
    if recorded_bytes(len(wiring.recorded), steps, decimate) > MAX_BYTES_IN_MEMORY:
        return wiring.without_hidden()
    return wiring


def require_room(scenario: Scenario, columns: int, steps: int, settings: Settings, source: str) -> None:
    """InputError for a recording that the disk has no room for, or the memory where they have to be in memory."""
    size = recorded_bytes(columns, steps, settings.decimate)
    if size <= MAX_BYTES_IN_MEMORY:
        return
    place = settings.stop_time_source(source)
    whole = {"for a MAT file": "mat" in settings.formats, "in memory": settings.open_inputs}
    for purpose in (text for text, applies in whole.items() if applies and size > MAX_BYTES_TOGETHER):
        rule = (
            f"must leave at most {MAX_BYTES_TOGETHER / 1e9:.2g} GB of recorded values {purpose}, {steps:.3g} steps "
            f"make {size / 1e9:.3g} GB; record fewer of them with --decimate, or choose another format"
        )
        raise InputError("stop_time", rule, scenario.stop_time, source=place)
    for folder, needed in _needed(size, settings.formats, settings.results_folder).items():
        free = shutil.disk_usage(folder).free
        if needed > free:
            rule = (
                f"must leave a recording that fits on the disk: {steps:.3g} steps make {size / 1e9:.3g} GB of values, "
                f"with the files {needed / 1e9:.3g} GB in {folder}, where {free / 1e9:.3g} GB are free; record "
                "fewer of them with --decimate"
            )
            raise InputError("stop_time", rule, scenario.stop_time, source=place)


def _needed(size: int, formats: Sequence[Format], folder: Path | None) -> dict[Path, float]:
    """Bytes that rows and files take in each folder; without a folder of results, a temporary file takes the rows."""
    if folder is None:
        return {Path(gettempdir()): size}
    existing = next((f for f in (folder, *folder.absolute().parents) if f.is_dir()), Path("."))
    return {existing: size * (1 + sum(_SHARES[name] for name in formats))}
