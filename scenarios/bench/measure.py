"""Costs of the units and of the closed loop, each beside the bare arithmetic, side by side in one process."""

import sys
import tempfile
import time as clock
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.controller.design import Design, DesignOptions, compute_design
from flexbeams.fmus.packaging.build import ensure_units
from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.structure import find_structure, read_structure
from flexbeams.scenarios.bench.bare_loops import BareLoops, Motion, NumpyLoops, bare_library, matrices_of
from flexbeams.scenarios.bench.unit_loops import Loop, chain, silent, unit_plan
from flexbeams.scenarios.definition.schema import find_scenario
from flexbeams.scenarios.definition.settings import BUILD_FOLDER, Settings
from flexbeams.scenarios.definition.signals import Signal
from flexbeams.scenarios.runs.prepare import draft_run
from flexbeams.scenarios.runs.scenario import prepare
from flexbeams.scenarios.simulation.cosimulation import Plan
from flexbeams.scenarios.simulation.stepping import stepper_library

SCENARIO = "tracking"
STEPS, ROUNDS = 30_000, 25
NUMPY_STEPS = 3_000  # of a unit's recursion in numpy, at most
REAL_TIME_LIMIT = 2e-4  # s, the sample time
GROWTH = {1: 5, 2: 5, 3: 5, 5: 5, 10: 2, 20: 1}  # beams to reduced_modes, fewer where the series would be too long
GROWTH_STEPS = 1_000
GROWTH_DESIGN = {"output_weight": "energy", "gevrey_order": 1.5}  # for which all of these have a design
SLOTS = 8  # transitions that the feedforward superposes


@dataclass(frozen=True, kw_only=True)
class Cost:
    """Least time over the rounds, and the median over the rounds of the ratio to the bare loop."""

    seconds: float  # for as many steps as were asked for
    us_per_step: float
    ratio: float | None  # None where the bare loop has nothing to do


@dataclass(frozen=True, kw_only=True)
class Target:
    """A figure beside what it must not pass."""

    name: str
    measured: float
    limit: float
    unit: str  # x (a ratio) or us

    @property
    def met(self) -> bool:
        """Within the limit."""
        return self.measured <= self.limit


def interleaved(variants: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, tuple[float, float]]:
    """Least seconds of each variant and the median ratio to the bare one; every round runs all, one after the other."""
    times = np.array([[measure() for measure in variants.values()] for _ in range(rounds)])
    bare = times[:, list(variants).index("bare")]
    return {
        name: (float(column.min()), float(np.median(column / bare)))
        for name, column in zip(variants, times.T, strict=True)
    }


def timed(work: Callable[[], object]) -> float:
    """Seconds that a call takes."""
    begin = clock.perf_counter()
    work()
    return clock.perf_counter() - begin


class Bench:
    """All measurements; `report` gets a line when units are built, `progress` the parts done and in all."""

    def __init__(
        self,
        steps: int = STEPS,
        rounds: int = ROUNDS,
        compiler: str = "zig",
        build_folder: Path = BUILD_FOLDER,
        report: Callable[[str], None] = lambda text: None,
        progress: Callable[[int, int], None] = lambda done, parts: None,
    ) -> None:
        self.steps, self.rounds, self._compiler, self._build = steps, rounds, compiler, build_folder
        self._report, self._progress = report, progress
        path, settings = find_scenario(SCENARIO), Settings(compiler=compiler, build_folder=build_folder)
        scenario, self.design = prepare(path, settings)
        scenario, draft = draft_run(path, scenario, self.design, settings, report)
        self._plan, self._starts, self.step = draft.plan, draft.starts, draft.step
        self._model = draft.models["plant"]
        self._files = self._units(
            {n: (str(scenario.instance[n].unit), m) for n, m in draft.models.items()}, self.design
        )
        self._stepper = stepper_library(build_folder, compiler)
        self._library = bare_library(build_folder, compiler, self._files["feedforward"])
        self.matrices = matrices_of(self.design, self._model)
        self._stack = ExitStack()
        self._folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="flexbeams_")))
        self._preview = float(draft.starts.get("feedforward", {}).get("preview", 0.0))
        self._target = np.array(scenario.input[0].targets[0].value) if scenario.input[0].targets else np.zeros(4)

    def __enter__(self) -> "Bench":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def measure(self, growth: Sequence[int] | None = None) -> dict[str, Any]:
        """Everything, in JSON's types. `growth` chooses numbers of beams."""
        parts: list[Callable[[], Any]] = [
            self.units,
            self.closed_loop,
            partial(self.superposed, 1),
            partial(self.superposed, SLOTS),
            self.real_time,
            *(partial(self.grown, beams) for beams in growth or GROWTH),
        ]
        results = []
        for done, part in enumerate(parts):
            self._progress(done, len(parts))
            results.append(part())
        units, closed_loop, one, several, real_time, *grown = results
        loops, transitions = [*units, closed_loop], [one, several]
        by_name = {loop["name"]: loop for loop in loops}
        plant, closed = by_name["plant"], by_name["closed loop"]
        targets = [
            Target(name="plant: FMI functions to bare", measured=plant["fmi"]["ratio"], limit=1.5, unit="x"),
            Target(name="closed loop: FMI functions to bare", measured=closed["fmi"]["ratio"], limit=1.3, unit="x"),
            Target(name="closed loop: runner to bare", measured=closed["runner"]["ratio"], limit=1.5, unit="x"),
            *(
                Target(
                    name=f"feedforward step, transitions: {t['transitions']}",
                    measured=t["fmi_us_per_step"],
                    limit=10.0,
                    unit="us",
                )
                for t in transitions
            ),
            Target(
                name="closed-loop step, p99.99",
                measured=1e6 * real_time["p99.99"],
                limit=1e6 * REAL_TIME_LIMIT,
                unit="us",
            ),
        ]
        return {
            "scenario": SCENARIO,
            "design_id": self.design.design_id,
            "steps": self.steps,
            "step_s": self.step,
            "rounds": self.rounds,
            "statistic": "least seconds and median ratio over rounds",
            "compiler": self._compiler,
            "platform": sys.platform,
            "loops": loops,
            "transitions": transitions,
            "real_time": real_time,
            "growth": grown,
            "targets": [{**asdict(t), "met": t.met} for t in targets],
        }

    def units(self) -> list[dict[str, Any]]:
        """Each unit alone, driven by the inputs that it has in the closed loop."""
        signals = self.closed_run()
        u, y_pm = _columns(signals, "controller.u["), _columns(signals, "plant.y_pm[")
        forces = np.zeros((self.steps, len(self._model.structure.beam)))
        plant_rows = np.ascontiguousarray(np.hstack([u[:-1], forces]))
        reference = np.hstack([_columns(signals, "feedforward.u_ff["), _columns(signals, "feedforward.x_ref["), y_pm])
        controller_rows = np.ascontiguousarray(reference[:-1])
        return [
            self.plant(plant_rows),
            self.feedforward(moving=True),
            self.feedforward(moving=False),
            self.controller(controller_rows),
        ]

    def closed_run(self) -> dict[str, Array]:
        """Every signal of the closed loop, (steps + 1,) each."""
        plan = replace(self._plan, columns=list(self._plan.sources), recorded=list(self._plan.sources.values()))
        loop = self._loop(self._files, plan, self._starts)
        loop.start()
        return loop.record(self.steps)

    def plant(self, rows: Array) -> dict[str, Any]:
        """The plant under rows of voltages and forces."""
        bare = self.bare()
        numpy = NumpyLoops(self.design, self.matrices)
        return self._compared(
            "plant",
            "BeamPlant",
            ("u", "force"),
            rows,
            bare,
            partial(bare.plant, rows),
            lambda k: numpy.plant_step(rows[k]),
        )

    def controller(self, rows: Array) -> dict[str, Any]:
        """The controller under rows of u_ff, x_ref and y_pm."""
        bare = self.bare()
        numpy = NumpyLoops(self.design, self.matrices)
        n_u, n = len(numpy.u), len(numpy.u) + len(numpy.x_est)
        return self._compared(
            "controller",
            "TrackingController",
            ("u_ff", "x_ref", "y_pm"),
            rows,
            bare,
            partial(bare.controller, rows),
            lambda k: numpy.controller_step(rows[k, :n_u], rows[k, n_u:n], rows[k, n:]),
        )

    def feedforward(self, moving: bool) -> dict[str, Any]:
        """The feedforward, one transition in progress all the time, or none."""
        rows = np.zeros((self.steps, len(self._target)))
        rows[1:] = self._target if moving else 0.0
        starts = {"transition_time": 1.25 * self.steps * self.step, "preview": self._preview}
        motion = self.motion(rows, starts)
        bare, numpy = self.bare(motion), NumpyLoops(self.design, self.matrices, motion)
        name = "feedforward, moving" if moving else "feedforward, at rest"
        loop = self._compared(
            name,
            "FlatnessFeedforward",
            ("y_target",),
            rows,
            bare,
            partial(bare.feedforward, 0, self.steps),
            numpy.feedforward_step,
            starts,
        )
        if not moving:  # nothing to compare with
            for variant in ("bare", "fmi", "runner", "numpy"):
                loop[variant]["ratio"] = None
        return loop

    def closed_loop(self) -> dict[str, Any]:
        """The closed loop of the scenario."""
        rows = self._rows(self._targets(self.steps))
        motion = self.closed_motion()
        bare = self.bare(motion)
        fmi = self._loop(self._files, silent(self._plan), self._starts)
        runner = self._loop(self._files, self._plan, self._starts)

        times = interleaved(
            {
                "bare": self._fresh(bare, partial(bare.closed, self.steps)),
                "fmi": partial(fmi.advance_from_start, rows),
                "runner": partial(runner.run_from_start, self.steps),
            },
            self.rounds,
        )
        numpy = NumpyLoops(self.design, self.matrices, motion)
        return self._costs("closed loop", times, _recursion(numpy.closed_step, self.steps))

    def closed_motion(self) -> Motion:
        """What the closed loop's feedforward does."""
        return self.motion(self._targets(self.steps), dict(self._starts["feedforward"]))

    def superposed(self, count: int) -> dict[str, Any]:
        """A step of the feedforward with that many transitions in progress, from a step after the last one began."""
        rows = np.zeros((self.steps + count + 1, len(self._target)))
        for k in range(count):
            rows[k + 1 :] = self._target * (k + 1) / count
        starts = {"transition_time": 1.25 * len(rows) * self.step, "preview": self._preview}
        motion = self.motion(rows, starts)
        bare = self.bare(motion)
        plan = unit_plan(self._files["feedforward"], self._folder, ("y_target",), rows, self.step, recorded=False)
        loop = self._loop({"unit": self._files["feedforward"]}, plan, {"unit": starts})

        def fmi() -> float:
            loop.start()
            loop.advance(rows[: count + 1])
            return loop.advance(rows[count + 1 :], count + 1)

        def arithmetic() -> float:
            bare.reset()
            bare.feedforward(0, count + 1)
            return timed(partial(bare.feedforward, count + 1, self.steps))

        return {"transitions": count, **_beside(interleaved({"bare": arithmetic, "fmi": fmi}, self.rounds), self.steps)}

    def real_time(self) -> dict[str, Any]:
        """How long single steps of the closed loop take through the FMI functions, s; half of the time it moves."""
        steps = max(10 * self.steps // 3, 1)
        period = round(2.0 / self.step)
        rows: Array = ((np.arange(steps) // period % 2)[:, None] * self._target).astype(np.float64)
        loop = self._loop(self._files, silent(self._plan), self._starts)
        loop.start()
        durations = loop.stepper.durations(0, self._rows(rows))
        median, p99, p9999 = np.quantile(durations, [0.5, 0.99, 0.9999])
        return {
            "steps": steps,
            "median": float(median),
            "p99": float(p99),
            "p99.99": float(p9999),
            "max": float(durations.max()),
            "limit": REAL_TIME_LIMIT,
            "over_limit": int(np.count_nonzero(durations > REAL_TIME_LIMIT)),
        }

    def grown(self, beams: int) -> dict[str, Any]:
        """Plant and controller of a row of beams."""
        kept = GROWTH[beams]
        structure = chain(read_structure(find_structure("kiel")), beams)
        design = compute_design(structure, DesignOptions(reduced_modes=kept, **GROWTH_DESIGN))  # type: ignore[arg-type]
        model = design.model()
        files = self._units({"plant": ("BeamPlant", model), "controller": ("TrackingController", model)}, design)
        matrices = matrices_of(design, model)
        bare = BareLoops(self._library, matrices, self.step)
        steps = min(self.steps, GROWTH_STEPS)
        random = np.random.default_rng(beams)
        result = {
            "beams": beams,
            "states": len(matrices.transition),
            "reduced_modes": kept,
            **GROWTH_DESIGN,
            "reduced_states": len(matrices.filter),
            "inputs": len(structure.patch),
            "steps": steps,
        }
        n_u, n = len(structure.patch), len(matrices.filter)
        for unit, arrays, width, call in (
            ("plant", ("u", "force"), n_u + beams, bare.plant),
            ("controller", ("u_ff", "x_ref", "y_pm"), n_u + n + len(structure.strain_gauge), bare.controller),
        ):
            scale = np.r_[np.full(n_u, 10.0), np.full(width - n_u, 1e-6)]
            rows = random.normal(size=(steps, width)) * scale
            folder = self._folder / str(beams)
            plan = unit_plan(files[unit], folder, arrays, rows, self.step, recorded=False)
            loop = self._loop({"unit": files[unit]}, plan, {}, folder)
            result[unit] = _beside(
                interleaved(
                    {"bare": self._fresh(bare, partial(call, rows)), "fmi": partial(loop.advance_from_start, rows)},
                    self.rounds,
                ),
                steps,
            )
        return result

    def bare(self, motion: Motion | None = None) -> BareLoops:
        """The bare loops of the scenario's design."""
        return BareLoops(self._library, self.matrices, self.step, motion)

    def motion(self, rows: Array, starts: Mapping[str, float | bool]) -> Motion:
        """The transitions that targets (steps, points) cause, with the durations that the unit plans."""
        plan = unit_plan(self._files["feedforward"], self._folder, ("y_target",), rows, self.step, recorded=False)
        loop = self._loop({"unit": self._files["feedforward"]}, plan, {"unit": starts})
        loop.start()
        begins = [k for k in range(1, len(rows)) if not np.array_equal(rows[k], rows[k - 1])]
        changes = [self.design.arrays["static_inverse"] @ (rows[k] - rows[k - 1]) for k in begins]
        durations, done = [], 0
        for k in begins:
            loop.advance(rows[done : k + 1], done)
            durations.append(float(loop.instances["unit"].get("planned_time")))
            done = k + 1
        return Motion(
            begins=np.array(begins, np.int64),
            durations=np.array(durations),
            steps=np.array(changes).reshape(len(begins), len(self.design.arrays["static_inverse"])),
            preview=float(starts.get("preview", 0.0)),
        )

    def unit_loop(
        self,
        name: str,
        arrays: Sequence[str],
        rows: Array,
        starts: Mapping[str, float | bool] | None = None,
        recorded: bool = False,
    ) -> Loop:
        """One unit of the scenario's design, driven by rows."""
        plan = unit_plan(self._files[name], self._folder, arrays, rows, self.step, recorded)
        return self._loop({"unit": self._files[name]}, plan, {"unit": starts or {}})

    def _compared(
        self,
        name: str,
        unit: str,
        arrays: Sequence[str],
        rows: Array,
        bare: BareLoops,
        arithmetic: Callable[[], None],
        numpy_step: Callable[[int], None],
        starts: Mapping[str, float | bool] | None = None,
    ) -> dict[str, Any]:
        instance = {"BeamPlant": "plant", "FlatnessFeedforward": "feedforward", "TrackingController": "controller"}
        fmi = self.unit_loop(instance[unit], arrays, rows, starts)
        runner = self.unit_loop(instance[unit], arrays, rows, starts, recorded=True)
        steps = min(self.steps, NUMPY_STEPS)
        times = interleaved(
            {
                "bare": self._fresh(bare, arithmetic),
                "fmi": partial(fmi.advance_from_start, rows),
                "runner": partial(runner.run_from_start, self.steps),
            },
            self.rounds,
        )
        return self._costs(name, times, _recursion(numpy_step, steps) * self.steps / steps)

    def _costs(self, name: str, times: Mapping[str, tuple[float, float]], numpy: float) -> dict[str, Any]:
        every = {**times, "numpy": (numpy, numpy / times["bare"][0])}
        return {"name": name} | {
            variant: asdict(Cost(seconds=seconds, us_per_step=1e6 * seconds / self.steps, ratio=ratio))
            for variant, (seconds, ratio) in every.items()
        }

    def _targets(self, count: int) -> Array:
        """The scenario's targets at each step, (count, points)."""
        signal = self._plan.external[0][1]
        assert isinstance(signal, Signal)
        return signal.sample(np.arange(count, dtype=np.float64) * self.step)

    def _rows(self, targets: Array) -> Array:
        """External signals of the closed loop with these targets; forces are zero."""
        rows = np.zeros((len(targets), sum(span.stop - span.start for span, _ in self._plan.external)))
        rows[:, : targets.shape[1]] = targets
        return rows

    def _units(self, wanted: Mapping[str, tuple[str, BeamModel]], design: Design) -> dict[str, Path]:
        return ensure_units(wanted, design, self._build, self._report, compiler=self._compiler)

    def _loop(
        self,
        files: Mapping[str, Path],
        plan: Plan,
        starts: Mapping[str, Mapping[str, float | bool]],
        folder: Path | None = None,
    ) -> Loop:
        loop = Loop(folder or self._folder, files, plan, self._stepper, self.step, starts)
        self._stack.callback(loop.close)
        return loop

    @staticmethod
    def _fresh(bare: BareLoops, work: Callable[[], None]) -> Callable[[], float]:
        def measure() -> float:
            bare.reset()
            return timed(work)

        return measure


def _columns(signals: Mapping[str, Array], prefix: str) -> Array:
    return np.column_stack([values for name, values in signals.items() if name.startswith(prefix)])


def _recursion(step: Callable[[int], None], steps: int) -> float:
    """Seconds of that many steps in Python."""
    begin = clock.perf_counter()
    for k in range(steps):
        step(k)
    return clock.perf_counter() - begin


def _beside(times: Mapping[str, tuple[float, float]], steps: int) -> dict[str, float]:
    return {
        "bare_us_per_step": 1e6 * times["bare"][0] / steps,
        "fmi_us_per_step": 1e6 * times["fmi"][0] / steps,
        "ratio": times["fmi"][1],
    }
