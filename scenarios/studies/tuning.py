"""Search for weights by differential evolution, from a scenario's disturbance to verified designs; resumable.

scipy's differential evolution minimises log(worst decay) + p log(noise voltage) for several prices p of noise, starting
from the scenario's own weights among others. Every candidate goes into a log, and the Pareto front is that of all of
them. The same seed proposes the same candidates, so that a search that was interrupted reads from its log what it has
evaluated before.
"""

import hashlib
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution

from flexbeams.controller.analysis import loop_of
from flexbeams.controller.closed_loop import sampled_plant
from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.margins import Margins, loop_margins
from flexbeams.controller.options import Weights
from flexbeams.controller.tuning import Candidate, Requirements, TuningProblem, pareto_front
from flexbeams.controller.verification import models_of
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError, InputError
from flexbeams.plant.threads import one_thread
from flexbeams.scenarios.definition.scenario_file import ScenarioFile
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.definition.signals import signal_of
from flexbeams.scenarios.runs.prepare import PreparedScenario, prepare_scenario

PRICES = (0.0, 0.1, 0.4)  # of noise against decay, each a search of its own
POPULATION = 8  # candidates for each weight
LOG = "candidates.jsonl"
INFEASIBLE = 100.0  # above every objective of a feasible candidate
SHOWN = 16  # points of the front that are verified and shown

Progress = Callable[[int, int, float], None]  # candidates evaluated, of all, best decay so far in s


@dataclass(frozen=True, kw_only=True)
class FrontPoint:
    """A point of the Pareto front, computed and verified as a design."""

    candidate: Candidate
    design: Design
    margins: dict[str, Margins]  # by plant


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """The result of a search."""

    scenario: str
    problem: TuningProblem
    published: Candidate
    evaluated: int
    feasible: int
    front: list[FrontPoint]  # by ascending noise
    chosen: int  # index in front


def tune(
    file: ScenarioFile,
    folder: Path,
    *,
    requirements: Requirements,
    evaluations: int,
    choose: int | None = None,
    notify: Callable[[str], None],
    progress: Progress,
) -> Tuning:
    """Searches weights for a scenario; `folder` keeps the log of candidates.

    Raises InputError for a scenario without a force on its plant, for a log of another search, and where no candidate
    meets the requirements; DesignError for a scenario whose design is refused.
    """
    prepared = prepare_scenario(file, Settings(record_animation=False), notify)
    with one_thread():
        problem = _problem(prepared, requirements)
        log = CandidateLog(folder / LOG, _fingerprint(prepared, requirements))
        candidates = _search(problem, log, evaluations, progress)
        front = _verified(problem, _thinned(pareto_front(candidates)), notify)
        if not front:
            raise InputError(
                "tune",
                f"found no weights that meet the requirements among {len(candidates)}; allow a smaller disk margin or "
                "uncertainty, or more --evaluations",
            )
        if choose is not None and not 1 <= choose <= len(front):
            raise InputError("--choose", f"must be a point of the front, 1 to {len(front)}", choose)
        return Tuning(
            scenario=file.name,
            problem=problem,
            published=problem.evaluate(Weights()),
            evaluated=len(candidates),
            feasible=sum(c.feasible for c in candidates),
            front=front,
            chosen=_knee(front) if choose is None else choose - 1,
        )


class CandidateLog:
    """Candidates by their weights in a file of JSON lines, which the next search with the same fingerprint reads."""

    def __init__(self, path: Path, fingerprint: str) -> None:
        self.path = path
        self._known: dict[str, Candidate] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            path.write_text(json.dumps({"search": fingerprint}) + "\n", encoding="utf-8")
            return
        lines = path.read_text(encoding="utf-8").splitlines()
        try:
            header = json.loads(lines[0])["search"]
        except (IndexError, KeyError, TypeError, json.JSONDecodeError):
            raise InputError("", "is not a log of candidates", source=str(path)) from None
        if header != fingerprint:
            raise InputError(
                "", "belongs to another search (scenario, requirements or seed); choose another --out", source=str(path)
            )
        for line in lines[1:]:
            try:
                entry = json.loads(line)
            except json.JSONDecodeError:  # cut off where the search was interrupted
                continue
            figures: dict[str, Any] = {k: math.nan if v is None else v for k, v in entry["figures"].items()}
            self._known[entry["key"]] = Candidate(**figures)

    def get(self, key: str) -> Candidate | None:
        """The candidate of a key, where it is known."""
        return self._known.get(key)

    def add(self, key: str, candidate: Candidate) -> None:
        """Appends a candidate."""
        self._known[key] = candidate
        figures = {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in candidate.figures().items()}
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"key": key, "figures": figures}) + "\n")


def _problem(prepared: PreparedScenario, requirements: Requirements) -> TuningProblem:
    plants = [name for name, kind in prepared.kinds.items() if kind.name == "BeamPlant"]
    if len(plants) != 1:
        raise InputError("instance", "must have one BeamPlant to tune for", len(plants), source=prepared.source)
    plant, design = plants[0], prepared.design
    known = design.structure.parameters()
    parameters = {name: float(v) for name, v in prepared.starts[plant].items() if name in known}
    return TuningProblem(
        design,
        prepared.models[plant],
        parameters,
        _forces(prepared, plant),
        prepared.scenario.stop_time,
        replace(requirements, voltage_limit=design.options.voltage_limit),
    )


def _forces(prepared: PreparedScenario, plant: str) -> Array:
    """Forces on the tips at every sample of the scenario, (k, r), N."""
    step = prepared.design.options.sample_time
    time: Array = step * np.arange(int(prepared.scenario.stop_time / step), dtype=np.float64)
    forces = np.zeros((len(time), len(prepared.design.structure.beam)))
    for drive in prepared.scenario.input:
        owner, _, variable = drive.to.partition(".")
        if owner != plant or not variable.startswith("force"):
            continue
        values = signal_of(drive, prepared.folder).sample(time)
        columns = slice(None) if variable == "force" else int(variable[6:-1]) - 1
        forces[:, columns] += values if variable == "force" else values[:, 0]
    if not np.any(forces):
        raise InputError(
            "input", f"must have a force on {plant} to tune for, such as that of disturbance", source=prepared.source
        )
    return forces


def _fingerprint(prepared: PreparedScenario, requirements: Requirements) -> str:
    """Hash of everything that candidates depend on."""
    parts = [
        prepared.design.design_id,
        asdict(requirements),
        asdict(prepared.scenario)["input"],
        prepared.scenario.stop_time,
        {name: sorted(values.items()) for name, values in prepared.starts.items()},
        {name: [instance.basis, instance.order] for name, instance in prepared.scenario.instance.items()},
    ]
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()[:32]


def _search(problem: TuningProblem, log: CandidateLog, evaluations: int, progress: Progress) -> list[Candidate]:
    """At least one generation for each price, `evaluations` candidates in all, about."""
    candidates: list[Candidate] = []
    size = POPULATION * len(problem.bounds)
    generations = max(1, evaluations // (len(PRICES) * size) - 1)
    total = len(PRICES) * (generations + 1) * size

    def objective(decades: Sequence[float], price: float) -> float:
        weights = problem.weights(decades)
        key = json.dumps(asdict(weights))
        candidate = log.get(key)
        if candidate is None:
            candidate = problem.evaluate(weights)
            log.add(key, candidate)
        candidates.append(candidate)
        best = min((c.worst_decay for c in candidates if c.feasible), default=math.inf)
        progress(len(candidates), total, best)
        if not candidate.feasible:
            return INFEASIBLE + candidate.violation
        step = problem.design.options.sample_time
        return math.log(max(candidate.worst_decay, step)) + price * math.log(max(candidate.noise_voltage, 1e-9))

    for k, price in enumerate(PRICES):
        differential_evolution(
            objective,
            problem.bounds,
            args=(price,),
            popsize=POPULATION,
            maxiter=generations,
            mutation=(0.4, 0.9),
            polish=False,
            tol=0.0,
            x0=problem.decades(),
            seed=problem.requirements.seed + k,
        )
    return candidates


def _thinned(front: list[Candidate]) -> list[Candidate]:
    """At most SHOWN points, spread over the logarithm of noise with the ends; hardly damped ones are left out."""
    damped = [c for c in front if c.noise_voltage > 0 and c.worst_decay < 0.9 * front[0].worst_decay] or front
    if len(damped) <= SHOWN:
        return damped
    noise = np.log([c.noise_voltage for c in damped])
    wanted = np.linspace(noise[0], noise[-1], SHOWN)
    return [damped[k] for k in sorted({int(np.argmin(np.abs(noise - w))) for w in wanted})]


def _verified(problem: TuningProblem, candidates: list[Candidate], notify: Callable[[str], None]) -> list[FrontPoint]:
    """The designs of candidates whose loops hold with exact margins."""
    points: list[FrontPoint] = []
    for candidate in candidates:
        weights = replace(Weights(), **candidate.weights)
        try:
            design = compute_design(problem.design.structure, replace(problem.design.options, weights=weights))
            margins = {
                name: loop_margins(loop_of(design, sampled_plant(model, design.options.sample_time)))
                for name, model in models_of(design.model()).items()
            }
        except DesignError as error:
            notify(f"left out a candidate with {candidate.noise_voltage:.3g} V of noise: {error}")
            continue
        alpha = min(m.disk.alpha for m in margins.values())
        if alpha >= problem.requirements.disk_margin:
            points.append(FrontPoint(candidate=replace(candidate, disk_margin=alpha), design=design, margins=margins))
    return points


def _knee(front: list[FrontPoint]) -> int:
    """The point furthest below the line between the front's ends, in logarithms of noise and decay."""
    noise = np.log([p.candidate.noise_voltage for p in front])
    decay = np.log([p.candidate.worst_decay for p in front])
    spans = max(noise[-1] - noise[0], 1e-12), max(decay[0] - decay[-1], 1e-12)
    return int(np.argmin((noise - noise[0]) / spans[0] + (decay - decay[-1]) / spans[1]))


def design_section(point: FrontPoint) -> str:
    """The tables [design] and [design.weights] of a scenario, TOML."""
    options, defaults = asdict(point.design.options), asdict(type(point.design.options)())
    weights, uncertainty = options.pop("weights"), options.pop("uncertainty")
    c = point.candidate
    lines = [
        f"# decay {c.decay:.3g} s, on uncertain plants up to {c.worst_decay:.3g} s; up to {c.peak_voltage:.0f} V; "
        f"noise {c.noise_voltage:.3g} V rms; disk margin {c.disk_margin:.3g}",
        "[design]",
        *(f"{name} = {_toml(value)}" for name, value in options.items() if value != defaults[name]),
        "",
        "[design.weights]",
        *(f"{name} = {value:.6g}" for name, value in weights.items() if value != defaults["weights"][name]),
    ]
    if uncertainty is not None:
        lines += ["", "[design.uncertainty]", *(f"{json.dumps(name)} = {v:.6g}" for name, v in uncertainty.items())]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    return f"{value!r}" if isinstance(value, int | float) and not isinstance(value, bool) else json.dumps(value)
