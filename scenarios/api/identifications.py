"""Identification of physical parameters from measured data."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BASES, BasisName
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.plant.identification.contradictions import require_consistent
from flexbeams.plant.identification.estimate import Loss, Settings
from flexbeams.plant.identification.experiment import Experiment, sensor_names
from flexbeams.plant.identification.method import Identification
from flexbeams.plant.identification.method import identify as identified
from flexbeams.plant.identification.plausibility import require_plausible
from flexbeams.plant.identification.reading import Column, Reading, read_experiment
from flexbeams.plant.identification.space import ParameterSpace, parameter_space, select
from flexbeams.plant.identification.static import static_maps_of
from flexbeams.plant.identification.steps_result import identify_in_steps
from flexbeams.plant.identification.writing import write_identified
from flexbeams.plant.static_maps import StaticMaps
from flexbeams.plant.structure import Structure, find_structure, read_structure
from flexbeams.scenarios.definition.arguments import require_choices
from flexbeams.scenarios.report.identification import write_identification
from flexbeams.scenarios.runs.observer import ignore_note

File = str | Path
Steps = Literal["all", "paper"]


def identify(
    *files: File,
    structure: File = "kiel",
    known: Mapping[str, float] | None = None,
    fixed: Iterable[str] = (),
    free: Iterable[str] = (),
    priors: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    weights: Mapping[str, float] | None = None,
    delays: Mapping[str, float] | None = None,
    offsets: Mapping[str, float] | None = None,
    fit_delays: bool = False,
    fit_offsets: bool = False,
    columns: Mapping[str, str | tuple[str, float]] | None = None,
    window: tuple[float | None, float | None] = (None, None),
    hold_back: Iterable[File] = (),
    uncoupled: Iterable[File] = (),
    free_start: Iterable[File] = (),
    basis: BasisName = "clamped_free",
    order: int | None = None,
    loss: Loss = "soft_l1",
    steps: Steps = "all",
    out: File | None = None,
    report: File | None = None,
    notify: Callable[[str], None] = ignore_note,
    progress: Callable[[int, int], None] = lambda done, most: None,
) -> Identification:
    """Fits the physical parameters of a structure to measured data and says what the data leave open.

    Nothing is random: equal data give equal parameters. Interrupted by Ctrl-C, it returns the best fit so far.

    Parameters
    ----------
    files
        CSV files with the columns time, u[k], y_pi[k], y_pm[k], force[j] of `results.csv`; sensors may be missing.
    structure
        The start: a shipped name or a structure file.
    known
        Values in SI of parameters that are known; one mass, at least, since voltages and deflections do not show the
        common scale of mass, stiffness and piezo ratio. Names may be patterns: `patch[].density` is that of all pairs.
    fixed, free
        Parameters that keep the start's value; parameters to identify (default all).
    priors
        Relative standard deviations of start values: 0.05 is 5 %.
    bounds
        Lower and upper limits, SI.
    weights, delays, offsets
        Relative weights of sensors, their known delays in s, and what they show at zero in SI, by name: `y_pm[2]`, or
        `y_pm[]` for all gauges.
    fit_delays, fit_offsets
        Whether a delay of each sensor, and an offset of each sensor and file, is fitted as well.
    columns
        Column of a signal, or column and factor to SI: {"y_pi[1]": ("laser 1 [mm]", 1e-3)}.
    window
        Begin and end of the times that count, s, in the files' own time.
    hold_back, uncoupled, free_start
        Files for validation only, files recorded with the springs taken off, files that do not start at rest.
    basis, order
        Galerkin basis of the model, and its modes a beam or polynomial degree.
    loss
        `soft_l1`, which limits the influence of outliers, or `linear`.
    steps
        `all` parameters at once, or `paper`: the two steps of the paper's section 4.1, for voltage steps. Step 1 takes
        the uncoupled files, the others show the springs.
    out, report
        Structure file and page to write.
    notify, progress
        Receive each stage in one line, and the evaluations of a stage: done, at most.

    Raises
    ------
    InputError
        Where a file, an option or the data break a rule, where the common scale stays open, and where sensors exchanged
        or with another sign would explain the data far better.

    Examples
    --------
    >>> import flexbeams as fb
    >>> start = {"plant.beam[1].youngs_modulus": 6.3e10, "plant.strain_noise_std": 1e-6}
    >>> stiffer = fb.run("single_beam", start=start, decimate=10)
    >>> file = stiffer.save("results/stiffer", figures=False, report=False) / "results.csv"
    >>> columns = {"u[1]": "plant.u[1]"}
    >>> result = fb.identify(file, structure="single_beam", free=["beam[1].youngs_modulus"], columns=columns)
    >>> f"{result.structure.beam[0].youngs_modulus:.3g}"
    '6.3e+10'
    """
    require_choices(steps=(steps, get_args(Steps)), loss=(loss, get_args(Loss)), basis=(basis, BASES))
    start = find_structure(str(structure))
    beams = read_structure(start)
    experiments = _experiments(beams, reading_of(columns or {}, window), files, hold_back, uncoupled, free_start)
    experiments = _without_offsets(experiments, of_sensors(beams, offsets or {}, "--offset", None))
    space = space_of(beams, known or {}, fixed, free, priors or {}, bounds or {})
    require_plausible(beams, experiments, space.names)
    weighted = of_sensors(beams, weights, "--weight", 1.0) if weights else None
    delayed = of_sensors(beams, delays or {}, "--delay", 0.0)
    settings = Settings(loss=loss, weights=weighted, delays=delayed, fit_delays=fit_delays, fit_offsets=fit_offsets)
    method = identify_in_steps if steps == "paper" else identified
    result = method(
        beams, experiments, space, basis=basis, order=order, settings=settings, notify=notify, progress=progress
    )
    require_consistent(result, notify)
    if out is not None:
        write_identified(start, result, Path(out))
    if report is not None:
        write_identification(result, Path(report))
    return result


def static_maps(
    *files: File,
    structure: File = "kiel",
    columns: Mapping[str, str | tuple[str, float]] | None = None,
    window: tuple[float | None, float | None] = (None, None),
) -> StaticMaps:
    """The static gains of each patch pair from measured steps, with 95 % intervals; arguments as those of `identify`.

    Raises InputError where a sensor is missing or the steps do not tell the pairs apart.
    """
    beams = read_structure(find_structure(str(structure)))
    reading = reading_of(columns or {}, window)
    experiments = [read_experiment(Path(file), beams, reading) for file in files]
    return static_maps_of(
        experiments, pairs=len(beams.patch), points=len(beams.point_of_interest), gauges=len(beams.strain_gauge)
    )


def _experiments(
    structure: Structure,
    reading: Reading,
    files: Sequence[File],
    hold_back: Iterable[File],
    uncoupled: Iterable[File],
    free_start: Iterable[File],
) -> list[Experiment]:
    """The experiments of all files; a file may be named twice."""
    held, loose, freely = (set(map(Path, chosen)) for chosen in (hold_back, uncoupled, free_start))
    every = dict.fromkeys([*map(Path, files), *sorted(held), *sorted(loose), *sorted(freely)])
    experiments = [
        read_experiment(
            path,
            structure,
            reading,
            start="free" if path in freely else "rest",
            uncoupled=path in loose,
            held_back=path in held,
        )
        for path in every
    ]
    if not experiments:
        raise InputError("files", "must be at least one CSV file")
    if all(experiment.held_back for experiment in experiments):
        raise InputError("--hold-back", "must leave at least one file to fit")
    return experiments


def space_of(
    structure: Structure,
    known: Mapping[str, float],
    fixed: Iterable[str],
    free: Iterable[str],
    priors: Mapping[str, float],
    bounds: Mapping[str, tuple[float, float]],
) -> ParameterSpace:
    """The free parameters; names may be patterns."""
    values = structure.parameters()
    settled: dict[str, float] = {}
    for pattern, value in known.items():
        settled |= dict.fromkeys(select(structure, pattern, "--known"), value)
    for pattern in fixed:
        settled |= {name: values[name] for name in select(structure, pattern, "--fix")}
    deviations: dict[str, float] = {}
    for pattern, share in priors.items():
        if not share > 0:
            raise InputError("--prior", "must be > 0 percent", f"{pattern}={100 * share:g}")
        deviations |= dict.fromkeys(select(structure, pattern, "--prior"), share)
    limits: dict[str, tuple[float, float]] = {}
    for pattern, pair in bounds.items():
        limits |= dict.fromkeys(select(structure, pattern, "--bounds"), pair)
    chosen = [name for pattern in free for name in select(structure, pattern, "--free")]
    checked = structure.with_parameters(settled)
    return parameter_space(checked, free=chosen or None, known=settled, bounds=limits, priors=deviations)


def _without_offsets(experiments: Sequence[Experiment], offsets: Array) -> list[Experiment]:
    return [replace(e, outputs=e.outputs - offsets[list(e.sensors)]) for e in experiments]


def of_sensors(structure: Structure, given: Mapping[str, float], option: str, default: float | None) -> Array:
    """A value for each sensor, y_pm[] for all gauges; > 0 for the default 1, >= 0 for 0, any for None, that is 0."""
    names = sensor_names(structure)
    values = np.full(len(names), default or 0.0)
    for name, number in given.items():
        chosen = [k for k, sensor in enumerate(names) if sensor == name or re.sub(r"\d+", "", sensor) == name]
        if not chosen:
            raise InputError(option, f"{name} is not a sensor" + suggestion(name, names))
        if default is not None and (number < 0 or (number == 0 and default == 1.0)):
            raise InputError(option, "must be > 0" if default == 1.0 else "must be >= 0", f"{name}={number:g}")
        values[chosen] = number
    return values


def reading_of(
    columns: Mapping[str, str | tuple[str, float]], window: tuple[float | None, float | None] = (None, None)
) -> Reading:
    """How files are read: the column of a signal, or column and factor to SI, and the times that count, s."""
    named = {}
    for signal, column in columns.items():
        name, factor = (column, 1.0) if isinstance(column, str) else column
        named[signal] = Column(name=name, factor=factor)
    return Reading(columns=named, begin=window[0], end=window[1])
