"""Plans of experiments for an identification, and the scenario that records one."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
import tomlkit

from flexbeams.plant.archive import write_whole
from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BasisName
from flexbeams.plant.errors import InputError
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.identification.expectation import Expectation, expectation
from flexbeams.plant.identification.experiment import Experiment, sensor_names
from flexbeams.plant.identification.plan import Criterion, Search, Segment, candidates, record
from flexbeams.plant.structure import Structure, find_structure, read_structure
from flexbeams.scenarios.api.identifications import File, of_sensors, space_of
from flexbeams.scenarios.definition.scenario_file import structure_files

DEFLECTION_NOISE, STRAIN_NOISE = 2e-5, 5e-7  # m and 1, standard deviations where none are given
SHARE_OF_LENGTH = 0.1  # of the shortest beam: deflections to which a plan keeps where no limit is given
SHORTEST = 20  # rows of a segment
Signals = Literal["steps", "sweeps", "both"]


@dataclass(frozen=True, kw_only=True)
class ExperimentPlan:
    """A proposed record and what it will tell."""

    structure: Path
    segments: tuple[Segment, ...]
    experiment: Experiment  # with the predicted outputs, without noise
    noise: Array  # (n_all,): standard deviations of the sensors, m and 1
    expected: Expectation
    sizes: Mapping[str, float] = field(default_factory=dict)  # mean deviation by record: the plan's, simple ones

    @property
    def largest_deflection(self) -> float:
        """Of any point of interest, m."""
        points = len(read_structure(self.structure).point_of_interest)
        return float(np.max(np.abs(self.experiment.outputs[:, :points])))


def plan_experiment(
    structure: File = "kiel",
    *,
    known: Mapping[str, float] | None = None,
    fixed: Iterable[str] = (),
    free: Iterable[str] = (),
    priors: Mapping[str, float] | None = None,
    noise: Mapping[str, float] | None = None,
    signals: Signals = "both",
    criterion: Criterion = "D",
    segments: int | None = None,
    duration: float | None = None,
    step: float = 1e-3,
    limit: float = 1000.0,
    deflection_limit: float | None = None,
    basis: BasisName = "clamped_free",
    order: int | None = None,
    seed: int = 0,
    out: File | None = None,
    progress: Callable[[int, int], None] = lambda done, most: None,
) -> ExperimentPlan:
    """Proposes the voltages that determine the parameters best, and writes the scenario that records them.

    Parameters
    ----------
    structure, known, fixed, free, priors, basis, order
        As those of `identify`.
    noise
        Standard deviations of the sensors by name, m and 1; default: 20 um and 0.5 um/m.
    signals
        Voltage `steps`, `sweeps`, or `both`, for each segment the better one.
    criterion
        D: the volume of the confidence region, A: the mean square deviation of the parameters.
    segments, duration
        Number of segments, default one for each patch pair, and duration of each, s; default ten periods of the slowest
        mode.
    step, limit, deflection_limit
        Of the record, s; of the voltages, V; of the points' deflections as the structure predicts them, m, by default a
        tenth of the shortest beam.
    seed
        Of the search: equal seeds give equal plans.
    out
        Scenario file to write; the voltages go into `<its name>_voltages.csv` beside it.
    progress
        Receives trials of the search: done, in all.

    Raises
    ------
    InputError
        Where an option breaks a rule, or the common scale of the parameters would stay open.
    """
    path = find_structure(str(structure))
    beams = read_structure(path)
    _require_positive(step=step, limit=limit, segment_time=duration, deflection_limit=deflection_limit)
    noises = _noise(beams, noise or {})
    space = space_of(beams, known or {}, fixed, free, priors or {}, {})
    model = beam_model(beams, basis, order)
    bound = deflection_limit or SHARE_OF_LENGTH * min(beam.length for beam in beams.beam)
    usable = candidates(
        model, space, duration=duration, step=step, sweeps=signals != "steps", steps=signals != "sweeps"
    )
    if usable.rows < SHORTEST:
        raise InputError("--segment-time", f"must be at least {SHORTEST} steps of {step:g} s", duration)
    count = segments or len(beams.patch)
    limits = {"limit": limit, "deflection_limit": bound}
    search = Search(model, space, usable, count, deviations=noises, criterion=criterion, **limits)

    def judged(chosen: Sequence[Segment]) -> ExperimentPlan:
        scaled, experiment = record(model, space, chosen, usable, bound)
        expected = expectation(model, space, experiment, noises)
        return ExperimentPlan(
            structure=path, segments=tuple(scaled), experiment=experiment, noise=noises, expected=expected
        )

    plan = _best(search, judged, seed, progress)
    if out is not None:
        write_plan(plan, Path(out))
    return plan


def _best(
    search: Search,
    judged: Callable[[Sequence[Segment]], ExperimentPlan],
    seed: int,
    progress: Callable[[int, int], None],
) -> ExperimentPlan:
    """The best record of the search, with its size and those of the simple records."""

    def size(plan: ExperimentPlan) -> float:
        return search.size(plan.expected.data)

    simple = {name: size(judged(chosen)) for name, chosen in search.simple().items()}
    best = min(map(judged, search.trials(seed, progress)), key=size)
    return replace(best, sizes={"the plan": size(best), **simple})


def _require_positive(**values: float | None) -> None:
    for name, value in values.items():
        if value is not None and not 0 < value < np.inf:
            raise InputError(f"--{name.replace('_', '-')}", "must be finite and > 0", value)


def _noise(structure: Structure, given: Mapping[str, float]) -> Array:
    """Standard deviations (n_all,) of the sensors' noise."""
    points, gauges = len(structure.point_of_interest), len(structure.strain_gauge)
    default = np.concatenate([np.full(points, DEFLECTION_NOISE), np.full(gauges, STRAIN_NOISE)])
    chosen = of_sensors(structure, given, "--noise", 1.0)
    named = of_sensors(structure, dict.fromkeys(given, 2.0), "--noise", 1.0) == 2.0
    return np.where(named, chosen, default)


def write_plan(plan: ExperimentPlan, path: Path) -> None:
    """Writes the scenario file, and the voltages as the CSV file that it takes them from."""
    voltages, time = plan.experiment.voltages, plan.experiment.time
    file = path.with_name(f"{path.stem}_voltages.csv")
    changes = np.flatnonzero(np.any(np.diff(voltages, axis=0, prepend=np.nan) != 0, axis=1))
    header = ",".join(["time", *(f"u[{k}]" for k in range(1, voltages.shape[1] + 1))])
    rows = (",".join(map(repr, [float(f"{time[k]:.9g}"), *map(float, voltages[k])])) for k in changes)
    text = plan_text(plan, path.parent, path.stem, file.name)
    write_whole(file, "\n".join([header, *rows, ""]).encode())
    write_whole(path, text.encode())


def plan_text(plan: ExperimentPlan, folder: Path, name: str, voltages: str) -> str:
    """The scenario file `name` in `folder`, whose voltages are in a file."""
    shipped = plan.structure in structure_files().values()
    structure = plan.structure.stem if shipped else Path(os.path.relpath(plan.structure, folder)).as_posix()
    names = sensor_names(read_structure(plan.structure))
    document = tomlkit.document()
    document.add(tomlkit.comment("Voltages that determine the parameters best, by flexbeams identify --plan."))
    for k, segment in enumerate(plan.segments, 1):
        listed = ", ".join(f"{voltage:.6g}" for voltage in segment.voltages)
        document.add(tomlkit.comment(f"Segment {k}: {segment.signal}, [{listed}] V"))
    experiment = plan.experiment
    document.update({"title": "Experiment for identification", "structure": structure})
    document.add("stop_time", tomlkit.item(float(f"{experiment.duration:.9g}")))
    document.add("step", tomlkit.item(experiment.step))
    document.add("instance", tomlkit.item({"plant": {"unit": "BeamPlant"}}))
    document.add("input", tomlkit.item([{"to": "plant.u", "table": {"file": voltages, "hold": "zero"}}]))
    sensors = [{"of": f"plant.{of}", "noise": float(noise)} for of, noise in zip(names, plan.noise, strict=True)]
    document.add("sensor", tomlkit.item(sensors))
    largest = {"name": "largest deflection", "measure": "largest", "of": "plant.y_pi", "unit": "m"}
    document.add("check", tomlkit.item([largest]))
    document.add("figure", tomlkit.item([{"file": _figure_name(name), "rows": [["plant.y_pi"], ["plant.u"]]}]))
    return tomlkit.dumps(document)


def _figure_name(name: str) -> str:
    return "".join(c if c.isascii() and (c.isalnum() or c in "_-") else "_" for c in name)
