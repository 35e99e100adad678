"""From a study file to its runs: inputs, measures, and the assignments of each controller."""

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexbeams.controller.options import DesignOptions
from flexbeams.fmus.packaging.kept_units import unit_folder
from flexbeams.plant.errors import FlexbeamsError, InputError, suggestion
from flexbeams.scenarios.definition.choices import Method
from flexbeams.scenarios.definition.schema import Check
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.definition.signals import TIME_TOLERANCE
from flexbeams.scenarios.definition.study import Study
from flexbeams.scenarios.definition.study_file import StudyFile
from flexbeams.scenarios.results.checks import column_indices
from flexbeams.scenarios.runs.observer import ignore_note
from flexbeams.scenarios.runs.prepare import PreparedScenario, prepare_scenario
from flexbeams.scenarios.runs.requirements import require_measurable
from flexbeams.scenarios.studies.axes import Axis, resolve_axes, with_option
from flexbeams.scenarios.studies.sampling import SamplePlan, plan_samples

RESERVED = ("run", "key", "failure", "difference")  # columns of a data set beside inputs and measures

Notify = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class StudyPlan:
    """A study whose names and values are checked: the inputs of every run, and what is measured."""

    file: StudyFile
    settings: Settings
    prepared: PreparedScenario  # with the scenario's own design
    axes: list[Axis]
    samples: SamplePlan
    checks: list[Check]  # the measures
    signals: tuple[str, ...]  # columns that are kept
    every: int  # steps between their rows
    batch: bool = True  # through the batch kernel where that applies

    @property
    def source(self) -> str:
        """The study's file, which messages name."""
        return str(self.file.path)

    @cached_property
    def fingerprint(self) -> str:
        """Hash of all that results depend on beside the inputs."""
        runs = [self.prepared, *([self.prepared.open_loop] if self.prepared.open_loop else [])]
        parts = [_identity(run) for run in runs]
        kept = [
            [asdict(c) for c in self.checks],
            list(self.signals),
            self.every,
            [a.name for a in self.axes],
            self.batch,
        ]
        return hashlib.sha256(json.dumps([parts, kept], sort_keys=True, default=str).encode()).hexdigest()[:32]

    @cached_property
    def keys(self) -> list[bytes]:
        """The key of each run, 16 bytes: the hash of its inputs."""
        return [hashlib.sha256(np.ascontiguousarray(row).tobytes()).digest()[:16] for row in self.samples.values]

    def header(self) -> dict[str, object]:
        """What a data set says of its study."""
        return {
            "flexbeams": version("flexbeams"),
            "fingerprint": self.fingerprint,
            "study": self.file.name,
            "title": self.file.study.title,
            "scenario": self.prepared.file.name,
            "method": self.samples.method,
            "seed": self.samples.seed,
            "runs": self.samples.runs,
            "inputs": {a.name: {"unit": a.unit, "nominal": a.nominal, "group": a.group} for a in self.axes},
            "measures": {c.name: {"unit": c.unit, "min": c.min, "max": c.max} for c in self.checks},
            "signals": {"columns": list(self.signals), "interval": self.every * self.prepared.step},
        }

    def designs(self) -> Iterator[tuple[DesignOptions | FlexbeamsError, NDArray[np.int64]]]:
        """The options of each distinct design, or why there is none, with the numbers of its runs."""
        chosen = [k for k, axis in enumerate(self.axes) if axis.option]
        distinct, index = np.unique(self.samples.values[:, chosen], axis=0, return_inverse=True)
        for k, row in enumerate(distinct):
            numbers = np.flatnonzero(index.ravel() == k)
            options = self.file.scenario.scenario.design
            try:
                for n, value in zip(chosen, row, strict=True):
                    options = with_option(options, self.axes[n].option, float(value))
                yield options, numbers
            except InputError as error:
                yield error, numbers


def _identity(run: PreparedScenario) -> list[Any]:
    """What the results of a run depend on beside the inputs."""
    folders = {unit_folder(run.design, m, Path(), run.settings.compiler).name for m in run.models.values()}
    provided = [name for name in run.scenario.instance if name not in run.kinds]
    return [
        asdict(replace(run.scenario, check=[], figure=[])),
        sorted(folders),
        run.step,
        run.settings.backend,
        run.starts,
        {name: hashlib.sha256(run.provided_fmu(name).read_bytes()).hexdigest() for name in provided},
        [
            hashlib.sha256((run.folder / drive.table.file).read_bytes()).hexdigest()
            for drive in run.scenario.input
            if drive.table
        ],
    ]


def plan_study(
    file: StudyFile,
    settings: Settings,
    *,
    runs: int | None = None,
    method: Method | None = None,
    seed: int | None = None,
    batch: bool = True,
    notify: Notify = ignore_note,
) -> StudyPlan:
    """The plan of a study; `runs`, `method` and `seed` in place of the file's.

    Raises FlexbeamsError for whatever is not possible.
    """
    study, source = file.study, str(file.path)
    settings = replace(
        settings,
        overrides={**study.start, **settings.overrides},
        stop_time=settings.stop_time or study.stop_time,
        record_animation=False,
    )
    prepared = prepare_study(file, settings, None, notify)
    checks = _measures(file, prepared, source)
    axes = resolve_axes(study.parameter, prepared, source)
    chosen = method or study.method
    samples = plan_samples(axes, chosen, runs or study.runs, study.seed if seed is None else seed, source)
    if chosen == "grid" and runs not in (None, samples.runs):
        raise InputError("--runs", f"must be {samples.runs}, all points of the grid", runs)
    if chosen == "saltelli" and samples.runs != (runs or study.runs):
        inputs = len(samples.groups)
        why = f"a Saltelli design of {inputs} inputs or groups has ({inputs} + 2) times a power of two"
        notify(f"{samples.runs} runs in place of {runs or study.runs}: {why}")
    signals, every = _signals(study, prepared, source)
    return StudyPlan(
        file=file,
        settings=settings,
        prepared=prepared,
        axes=axes,
        samples=samples,
        checks=checks,
        signals=signals,
        every=every,
        batch=batch,
    )


def prepare_study(
    file: StudyFile, settings: Settings, options: DesignOptions | None, notify: Notify = ignore_note
) -> PreparedScenario:
    """The study's scenario without checks and figures, with other options of the design where they are given."""
    scenario = replace(file.scenario.scenario, check=[], figure=[])
    if options is not None:
        scenario = replace(scenario, design=options)
    if file.study.signals is not None:
        scenario = replace(scenario, record=[*(scenario.record or []), *file.study.signals.record])
    return prepare_scenario(replace(file.scenario, scenario=scenario), settings, notify)


def _measures(file: StudyFile, prepared: PreparedScenario, source: str) -> list[Check]:
    """The checks of the scenario that are kept, and the study's own measures."""
    study, known = file.study, {check.name: check for check in file.scenario.scenario.check}
    names = study.checks if study.checks is not None else [] if study.measure else list(known)
    for k, name in enumerate(names, 1):
        if name not in known:
            rule = "is not a check of the scenario" + suggestion(name, known)
            raise InputError(f"checks[{k}]", rule, name, source=source)
    chosen = [*(known[name] for name in names), *study.measure]
    if not chosen:
        raise InputError("measure", "must be given at least once where the scenario has no checks", source=source)
    taken = set(RESERVED)
    for check in chosen:
        where = f"measure {check.name!r}"
        if check.name in taken:
            raise InputError(where, f"must differ from others and from {', '.join(RESERVED)}", source=source)
        taken.add(check.name)
        last = check.after if check.before is None else check.before
        if last > prepared.scenario.stop_time + TIME_TOLERANCE:
            raise InputError(where, f"looks at {last:g} s, behind the end of the run", source=source)
        try:
            require_measurable(replace(prepared.scenario, check=[check]), prepared.wiring.columns, source)
        except InputError as error:
            key = error.key.replace("check[1]", where)
            raise InputError(key, error.rule, error.value, source=source) from None
    return chosen


def _signals(study: Study, prepared: PreparedScenario, source: str) -> tuple[tuple[str, ...], int]:
    """The columns that are kept of each run, and how many steps apart."""
    if study.signals is None:
        return (), 1
    columns = prepared.wiring.columns
    chosen = [columns[k] for name in study.signals.record for k in column_indices(columns, name)]
    ratio = study.signals.interval / prepared.step
    if ratio < 0.5 or abs(ratio - round(ratio)) > 1e-6:
        rule = f"must be a whole number of steps of {prepared.step:g} s"
        raise InputError("signals.interval", rule, study.signals.interval, source=source)
    return tuple(dict.fromkeys(chosen)), round(ratio)
