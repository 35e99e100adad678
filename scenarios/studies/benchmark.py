"""Fixed scenarios and measures for controllers: one's own beside none, feedforward, published, offset-free and tuned.

One's own is an FMU with the variables of TrackingController, of which it needs `y_pm` and `u` only, or a Python class:
`Mine(design)` makes an object that is called at every sample, `u = mine(y_pm, x_ref, u_ff)`. Its voltages reach the
plant at the next sample, as those of the unit do, and are held within the voltage limit.
"""

import importlib.util
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import FlexbeamsError, InputError
from flexbeams.scenarios.definition.scenario_file import ScenarioFile, load_scenario
from flexbeams.scenarios.definition.schema import Check, Instance, Scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.importing.fmu import unit_description
from flexbeams.scenarios.runs.prepare import prepare_scenario
from flexbeams.scenarios.runs.run_view import RunView
from flexbeams.scenarios.runs.scenario import run_prepared
from flexbeams.scenarios.runs.simulation import Simulation

BENCHMARK_VERSION = 1  # of cases and measures: figures of one version may lie beside each other
MINE = "mine"


@dataclass(frozen=True, kw_only=True)
class Case:
    """A scenario of the benchmark, with start values in place of its own."""

    name: str
    scenario: str
    start: Mapping[str, float]
    after: float  # s, when the motion or the disturbance begins


CASES = (
    Case(name="tracking", scenario="tracking", start={}, after=1.0),
    Case(name="noise", scenario="tracking", start={"plant.strain_noise_std": 1e-7}, after=1.0),
    Case(name="model errors", scenario="mismatch", start={}, after=1.0),
    Case(name="exact plant", scenario="high_fidelity", start={}, after=1.0),
    Case(name="hammer blow", scenario="disturbance", start={}, after=1.0),
)
CANDIDATES = ("none", "feedforward", "published", "offset-free", "tuned")
UNITS = {
    "error at the end": "m",
    "largest overshoot": "m",
    "settled after": "s",
    "largest voltage": "V",
    "largest change of a voltage in one sample": "V",
}


def checks(case: Case, scenario: Scenario) -> list[Check]:
    """The measures of a case; a blow has no target, but the rest before it."""
    blow = not any(drive.targets for drive in scenario.input)
    reference: Any = "zero" if blow else "target"
    measures: dict[str, tuple[Any, str, Any]] = {
        "error at the end": ("end_deviation", "plant.y_pi", reference),
        "largest overshoot": ("largest" if blow else "overshoot", "plant.y_pi", reference),
        "settled after": ("decay_time" if blow else "motion_settling_time", "plant.y_pi", reference),
        "largest voltage": ("largest", "plant.u", "zero"),
        "largest change of a voltage in one sample": ("largest_change", "plant.u", "zero"),
    }
    return [
        Check(name=name, measure=kind, of=of, reference=against, after=case.after, unit=UNITS[name])
        for name, (kind, of, against) in measures.items()
    ]


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """Values by case, candidate and measure; the reason in place of the values where a run failed."""

    values: Mapping[str, Mapping[str, Mapping[str, float] | str]]
    controller: str  # one's own, empty without

    def record(self) -> dict[str, Any]:
        """Content of benchmark.json."""
        return {
            "flexbeams": version("flexbeams"),
            "benchmark": BENCHMARK_VERSION,
            "controller": self.controller,
            "cases": {case.name: {"scenario": case.scenario, "start": dict(case.start)} for case in CASES},
            "units": UNITS,
            "results": self.values,
        }


def run_benchmark(
    controller: str, settings: Settings, progress: Callable[[str, int, int], None], stop_time: float | None = None
) -> Benchmark:
    """Runs all cases with all candidates, and with one's own `controller`: FILE.fmu, FILE.py:Class, or empty for none.

    Raises FlexbeamsError where that cannot be loaded.
    """
    own = _own_controller(controller) if controller else None
    names = [*CANDIDATES, *([MINE] if own is not None else [])]
    values: dict[str, dict[str, dict[str, float] | str]] = {}
    done, total = 0, len(CASES) * len(names)
    for case in CASES:
        values[case.name] = {}
        for name in names:
            progress(f"{case.name}, {name}", done, total)
            values[case.name][name] = _measured(case, name, own, replace(settings, stop_time=stop_time))
            done += 1
    progress("", done, total)
    return Benchmark(values=values, controller=controller)


Own = Path | Callable[[Any], Callable[..., Any]]


def _measured(case: Case, name: str, own: Own | None, settings: Settings) -> dict[str, float] | str:
    """The measures of one run, or why it has none."""
    settings = replace(settings, overrides=dict(case.start), record_animation=False)
    try:
        file = _with(load_scenario(case.scenario), case, name, own)
        if name == MINE and callable(own):
            view = _stepped(file, settings, own)
            return {name: check.value for name, check in view.checks.items()}
        run = run_prepared(prepare_scenario(file, settings))
        if run.recording.failure is not None:
            return str(run.recording.failure)
        return {o.name: o.value for o in run.outcomes}
    except FlexbeamsError as error:
        if name == MINE and isinstance(error, InputError):
            raise
        return str(error)


def _with(file: ScenarioFile, case: Case, name: str, own: Own | None) -> ScenarioFile:
    """The scenario of a case with a candidate in place of its controller, and the measures of the benchmark."""
    scenario = replace(file.scenario, check=checks(case, file.scenario), figure=[])
    if name == "none":
        scenario = replace(scenario, connection=[c for c in scenario.connection if c.to != "plant.u"])
    elif name == "feedforward":
        controller = replace(scenario.instance["controller"], start={"feedback": False})
        scenario = replace(scenario, instance={**scenario.instance, "controller": controller})
    elif name in ("offset-free", "tuned"):
        scenario = replace(scenario, design=load_scenario(_design_of(name, case)).scenario.design)
    elif isinstance(own, Path):
        known = {v.name.partition("[")[0] for v in unit_description(own, "--controller", "").modelVariables}
        wires = [c for c in scenario.connection if c.to.partition(".")[0] != "controller" or c.to[11:] in known]
        instance = {**scenario.instance, "controller": Instance(fmu=str(own.resolve()))}
        scenario = replace(scenario, connection=wires, instance=instance)
    return replace(file, scenario=scenario)


def _design_of(name: str, case: Case) -> str:
    """The scenario whose design a candidate has: the offset-free one is made for the statics of its plant."""
    if name == "tuned":
        return "disturbance_tuned"
    return "offset_free_high_fidelity" if case.scenario == "high_fidelity" else "offset_free"


def _stepped(file: ScenarioFile, settings: Settings, own: Callable[[Any], Callable[..., Any]]) -> RunView:
    """A run whose controller is called in Python at every sample."""
    with Simulation(file, settings, without=["controller"]) as simulation:
        design = simulation.prepared.design
        limit, pairs = design.options.voltage_limit, len(design.structure.patch)
        law = _guarded(own, design)
        u = np.clip(simulation["feedforward.u_ff"], -limit, limit)
        steps = simulation.prepared.steps
        for _ in range(steps):
            simulation["plant.u"] = u
            wanted = _guarded(
                law, simulation["plant.y_pm"], simulation["feedforward.x_ref"], simulation["feedforward.u_ff"]
            )
            u = np.clip(_numbers(wanted), -limit, limit)
            if u.shape != (pairs,) or not np.all(np.isfinite(u)):
                raise InputError("--controller", f"must give {pairs} finite voltages", str(wanted))
            simulation.step()
        simulation["plant.u"] = u  # in the last row as well
        return simulation.result()


def _guarded(function: Callable[..., Any], *arguments: Any) -> Any:
    """What a user's function returns; its exceptions in one line."""
    try:
        return function(*arguments)
    except Exception as error:
        text, frames = " ".join(str(error).split()), traceback.extract_tb(error.__traceback__)[1:]
        own = next((f for f in frames if not f.filename.startswith("<")), None)
        place = f" in line {own.lineno} of {own.filename}" if own else ""
        raise InputError("--controller", f"raised {type(error).__name__}{place}: {text}") from error


def _numbers(values: Any) -> Array:
    """As an array; NaN for what is none."""
    try:
        return np.asarray(values, dtype=float)
    except (ValueError, TypeError, OverflowError):
        return np.array(np.nan)


def _own_controller(text: str) -> Own:
    """An FMU, or the class of FILE.py:Class; InputError where there is none."""
    name, colon, attribute = text.rpartition(":")
    path = Path(name if colon and attribute.isidentifier() and name.endswith(".py") else text)
    if not path.is_file():
        raise InputError("--controller", "must be FILE.fmu or FILE.py:Class, of a file that exists", text)
    if path.suffix.lower() == ".fmu":
        return path
    if path == Path(text):
        raise InputError("--controller", "must name the class of a Python file: FILE.py:Class", text)
    spec = importlib.util.spec_from_file_location(f"benchmark_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    _guarded(spec.loader.exec_module, module)
    found = getattr(module, attribute, None)
    if not callable(found):
        raise InputError("--controller", f"has no class {attribute}", str(path))
    return found  # type: ignore[no-any-return]
