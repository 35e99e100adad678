"""A run as a notebook uses it: arrays by name, checks, units, tables of other libraries, and a page."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.definition.choices import Format
from flexbeams.scenarios.definition.declaration import by_index
from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.results.checks import Outcome
from flexbeams.scenarios.results.compare import FinishedRun, read_folder
from flexbeams.scenarios.results.curves import array_name
from flexbeams.scenarios.results.files import json_values
from flexbeams.scenarios.results.formats import require_formats
from flexbeams.scenarios.results.run import Run
from flexbeams.scenarios.runs.files import REPORT, write_loaded, write_run
from flexbeams.scenarios.runs.tables import to_pandas, to_xarray
from flexbeams.scenarios.simulation.recording import Recording

_FRAME = '<iframe srcdoc="{}" style="width:100%;height:{}px;border:0" title="{}" loading="lazy"></iframe>'
_HEIGHT = 720  # pixels of a page in a notebook


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RunView(Mapping[str, Array]):
    """A finished run: a mapping of recorded arrays by name, in SI units.

    `run["plant.y_pi"]` is (rows, elements) and `run["plant.y_pi[1]"]` (rows,), C-contiguous and read-only; row k holds
    the values at `run.time[k]`. `run["plant.w"]` (rows, beams, stations) are the deflections along the beams, from the
    clamp to the tip. Keys are the names of the arrays.

    Attributes
    ----------
    name, summary, recording
        Name of the scenario or package, content of summary.json, and all that was recorded.
    settings
        The options of the run.

    Examples
    --------
    >>> import flexbeams as fb
    >>> run = fb.run("step_response", stop_time=0.02)
    >>> run["plant.y_pi"].shape, run.units["plant.y_pi"], run["plant.w"].shape
    ((101, 4), 'm', (101, 3, 21))
    """

    name: str
    summary: dict[str, Any]
    recording: Recording
    outcomes: Sequence[Outcome]
    settings: Settings
    finished: Run | None = None  # None for a run that was loaded from a folder
    folder: Path | None = None  # that it was loaded from

    @classmethod
    def of(cls, run: Run) -> "RunView":
        """The view of a run of this process."""
        return cls(
            name=run.name,
            summary=run.summary,
            recording=run.recording,
            outcomes=run.outcomes,
            settings=run.settings,
            finished=run,
        )

    @property
    def time(self) -> Array:
        """Times of the rows (rows,), s."""
        time = self.recording.time.view()
        time.setflags(write=False)
        return time

    @property
    def scenario(self) -> Scenario | None:
        """The scenario, with the settings applied; None for a loaded run."""
        return None if self.finished is None else self.finished.scenario

    @property
    def design(self) -> Design | None:
        """The design of the units; None for a package and for a loaded run."""
        return None if self.finished is None else self.finished.design

    @property
    def open_loop(self) -> Recording | None:
        """The recording without control that the scenario compares with."""
        return None if self.finished is None else self.finished.open_loop

    @cached_property
    def _columns(self) -> dict[str, list[str]]:
        """Names of the elements of each array; of a scalar, its own."""
        arrays: dict[str, list[str]] = {}
        for column in [*self.recording.columns, *self.recording.deflection_columns]:
            arrays.setdefault(array_name(column), []).append(column)
        return {name: by_index(columns) for name, columns in arrays.items()}

    @cached_property
    def _arrays(self) -> dict[str, Array]:
        """The arrays and elements that were asked for."""
        return {}

    def __getitem__(self, name: str) -> Array:
        """The array or element of a name; InputError, which is a KeyError as well, where it is not recorded."""
        if name not in self._arrays:
            self._arrays[name] = self._array(name)
        return self._arrays[name]

    def _array(self, name: str) -> Array:
        recording = self.recording
        columns = self._columns.get(name)
        if columns is None and name not in recording.columns and name not in recording.deflection_columns:
            raise NotRecordedError(name, "is not recorded" + suggestion(name, self._columns))
        chosen = columns or [name]
        table, known = recording.values, recording.columns
        if chosen[0] not in known:
            assert recording.deflections is not None
            table, known = recording.deflections, recording.deflection_columns
        values = table[:, [known.index(column) for column in chosen]]
        shape = _shape(chosen) if columns else ()
        array = np.ascontiguousarray(values.reshape(len(values), *shape))
        array.setflags(write=False)
        return array

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def final(self, name: str) -> Array:
        """The last row of an array, a copy; () for a scalar."""
        last: Array = self[name][-1].copy()
        return last

    @cached_property
    def units(self) -> dict[str, str]:
        """Units of measurement of arrays and elements; `1` where a quantity has none, empty where they are unknown."""
        signals = self.summary.get("signals", {})
        none = "1" if signals else ""  # a run that was killed has not noted them
        units = {c: signals.get(c, {}).get("unit") or none for c in self.recording.columns}
        units |= dict.fromkeys(self.recording.deflection_columns, "m")
        return {**{name: units[columns[0]] for name, columns in self._columns.items()}, **units}

    @cached_property
    def checks(self) -> dict[str, Outcome]:
        """The checks by name, with `value`, `limit`, `unit` and `passed`."""
        return {outcome.name: outcome for outcome in self.outcomes}

    @property
    def metrics(self) -> dict[str, float]:
        """Values of the checks, largest magnitudes of all signals, final deflections."""
        metrics: dict[str, float] = self.summary.get("metrics", {})  # a run that was killed has none
        return metrics

    @property
    def passed(self) -> bool:
        """Whether the run is complete and all checks hold."""
        return bool(self.summary["complete"]) and all(o.passed for o in self.outcomes)

    def to_pandas(self) -> Any:
        """A pandas.DataFrame with a column for each element over the index `time` in s; `attrs["units"]` by column.

        Needs the extra `pandas`.
        """
        return to_pandas(self.recording, self.units)

    def to_xarray(self) -> Any:
        """An xarray.Dataset with a variable for each array over `time` in s, with the attribute `units`.

        The other dimensions are `point`, `patch_pair`, `gauge`, `beam`, `station`, counted from 1; those of other
        arrays are named after them. Needs the extra `xarray`.
        """
        return to_xarray(self.recording.time, self, self.units, {"scenario": self.name})

    def save(
        self, folder: str | Path, *, formats: Sequence[Format] = ("csv",), report: bool = True, figures: bool = True
    ) -> Path:
        """Writes the files that `flexbeams run` writes, results in these formats.

        The report and the figures of a loaded run are copies of those in its folder. Raises InputError for a folder
        with files that no run wrote, and a format whose package is missing.
        """
        require_formats(formats)
        if self.finished is not None:
            write_run(self.finished, Path(folder), figures=figures, report=report, formats=formats)
        else:
            write_loaded(self.as_finished(), Path(folder), figures=figures, report=report, formats=formats)
        return Path(folder)

    def as_finished(self) -> FinishedRun:
        """The run as comparisons take it."""
        summary = json_values(self.summary)
        return FinishedRun(label=self.name, folder=self.folder or Path(), summary=summary, recording=self.recording)

    def __repr__(self) -> str:
        lines = [f"{self.name}: {len(self.time)} rows up to {self.time[-1]:g} s"]
        if not self.summary["complete"]:
            lines[0] += ", incomplete"
        checks = self.summary.get("checks", [])
        lines += [f"  {c['name']}: {c['value']:.4g} {c['unit']}".rstrip() + _verdict(c) for c in checks]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """The report in a frame of its own, with checks, plots and animation; it needs nothing from outside."""
        page = None
        if self.finished is not None and self.recording.complete:
            from flexbeams.scenarios.report.report import report_html

            page = report_html(self.finished)
        elif self.folder is not None and (self.folder / REPORT).is_file():
            page = (self.folder / REPORT).read_text(encoding="utf-8")
        if page is None:
            return f"<pre>{escape(repr(self))}</pre>"
        return framed(page, self.name)


def framed(page: str, title: str) -> str:
    """A complete page in a frame of its own, as part of another page."""
    return _FRAME.format(escape(page), _HEIGHT, escape(title))


class NotRecordedError(InputError, KeyError):
    """A signal that a run has not recorded; a KeyError too, as mappings raise."""


def _verdict(check: Mapping[str, Any]) -> str:
    return "" if check["limit"] is None else ", holds" if check["passed"] else ", FAILED"


def _shape(columns: Sequence[str]) -> tuple[int, ...]:
    """Sizes of an array by the indices of its last element; () for a scalar, (n,) where they leave gaps."""
    match = re.search(r"\[([0-9,]+)\]$", columns[-1])
    if match is None:
        return ()
    sizes = tuple(int(size) for size in match[1].split(","))
    return sizes if np.prod(sizes) == len(columns) else (len(columns),)


def load(folder: str | Path) -> RunView:
    """Reads the folder of a finished run, with its signals and checks.

    Parameters
    ----------
    folder
        Such as results/tracking, as `flexbeams run` or `run.save` writes it; CSV, Parquet, MAT or MF4.

    Returns
    -------
    RunView
        The run, without its design. Of a run that was killed, the rows that are there, without checks.

    Raises
    ------
    InputError
        For a folder without results, or with results that were changed.

    Examples
    --------
    >>> import flexbeams as fb
    >>> folder = fb.run("step_response", stop_time=0.02).save("results/short", figures=False, report=False)
    >>> fb.load(folder)["plant.u"].shape
    (101, 4)
    """
    path = Path(folder)
    read = read_folder(path, path.name)
    changed = {k: v for k, v in read.summary.get("settings", {}).items() if k in {f.name for f in fields(Settings)}}
    return RunView(
        name=str(read.summary["scenario"]),
        summary=read.summary,
        recording=read.recording,
        outcomes=[Outcome.of_record(check) for check in read.summary.get("checks", [])],
        settings=Settings(**{**changed, "overrides": read.summary.get("set", {})}),
        folder=path,
    )
