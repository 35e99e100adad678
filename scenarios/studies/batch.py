"""The standard loop of a study through the batch kernel: when it applies, what it is given, what its figures mean.

It covers feedforward, controller and plant, wired as in the paper and stepped at the controller's sample time (Jacobi),
where only the plant varies from run to run. Everything else goes through the FMI units, and so do samples that the
kernel reports as outside of what it covers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexbeams.fmus.interface.variables import Interface
from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.declaration import element_names
from flexbeams.scenarios.definition.schema import Check
from flexbeams.scenarios.definition.values import own_start
from flexbeams.scenarios.results.checks import Measurement
from flexbeams.scenarios.runs.prepare import PreparedScenario
from flexbeams.scenarios.runs.repeated import RepeatedRun, lean
from flexbeams.scenarios.simulation.batch_kernel import CHANGE, FIRST, LARGEST, LAST, OUT, SMALLEST, BatchTask
from flexbeams.scenarios.simulation.recording import Recording, step_times
from flexbeams.scenarios.studies.axes import Axis
from flexbeams.scenarios.studies.loop_wires import Roles, standard_loop

SETTLING = ("settling_time", "motion_settling_time")
COVERED = ("largest", "end_deviation", "largest_change", "overshoot", "overshoot_percent", *SETTLING)
SIGNALS = ("y_pi", "y_pm", "u")  # of the plant, by their number in batch.h


@dataclass(frozen=True, kw_only=True)
class BatchMeasure:
    """How a measure follows from the figures of its elements."""

    check: Check
    elements: slice  # of the task's measured elements
    reference: Array  # (elements,), of a reference that is known before the run
    factor: float  # of the value


@dataclass(frozen=True, kw_only=True)
class BatchPlan:
    """What a worker needs to run samples through the kernel; small enough to send."""

    task: BatchTask
    measures: tuple[BatchMeasure, ...]
    base: Array  # (value_count,) values of the plant's variables
    places: tuple[tuple[tuple[int, float], ...], ...]  # of each axis: value references with factors

    def values(self, samples: Array) -> Array:
        """Values (n, value_count) of the plant's variables for samples (n, axes)."""
        values = np.tile(self.base, (len(samples), 1))
        for k, places in enumerate(self.places):
            for reference, factor in places:
                values[:, reference] = samples[:, k] * factor
        return values

    def measured(self, figures: Array) -> Array:
        """Measures (n, measures) from figures (n, elements, FIGURES)."""
        columns = [self._measured(m, figures[:, m.elements]) for m in self.measures]
        return np.stack(columns, axis=1)

    def scales(self, figures: Array) -> Array:
        """What differences of measures are relative to (n, measures): the largest value of the signal in its window.

        Of settling times it is the time itself, of an overshoot in percent the smallest reference counts.
        """
        scales = self.measured(figures)
        for k, measure in enumerate(self.measures):
            if measure.check.measure in SETTLING:
                continue
            part = figures[:, measure.elements]
            size = np.max(np.maximum(np.abs(part[:, :, LARGEST]), np.abs(part[:, :, SMALLEST])), axis=1)
            if measure.check.measure == "overshoot_percent":
                size = 100 * size / max(float(np.min(np.abs(measure.reference))), 1e-300)
            scales[:, k] = np.maximum(scales[:, k], measure.factor * size)
        return scales

    def _measured(self, measure: BatchMeasure, figures: Array) -> Array:
        check = measure.check
        reference = np.broadcast_to(measure.reference, figures.shape[:2])
        if check.reference in ("end", "start"):
            reference = figures[:, :, LAST if check.reference == "end" else FIRST]
        above, below = figures[:, :, LARGEST] - reference, figures[:, :, SMALLEST] - reference
        match check.measure:
            case "largest":
                value = np.max(np.maximum(np.abs(above), np.abs(below)), axis=1)
            case "end_deviation":
                value = np.max(np.abs(figures[:, :, LAST] - reference), axis=1)
            case "largest_change":
                value = np.max(figures[:, :, CHANGE], axis=1)
            case "overshoot" | "overshoot_percent":
                over = np.maximum(np.where(reference > 0, above, np.where(reference < 0, -below, 0.0)), 0.0)
                if check.measure == "overshoot_percent":
                    with np.errstate(divide="ignore", invalid="ignore"):
                        over = 100 * (over / np.abs(reference))
                value = np.max(over, axis=1)
            case _:
                last = np.max(figures[:, :, OUT], axis=1)
                late = step_times(last.astype(np.int64), self.task.step) - check.after
                value = np.where(last < 0, 0.0, np.maximum(late, 0.0))
        return np.asarray(measure.factor * value, dtype=float)


def batch_plan(
    prepared: PreparedScenario, axes: Sequence[Axis], checks: Sequence[Check], files: Mapping[str, Path], library: Path
) -> BatchPlan | None:
    """The plan for the batch kernel; None where the loop is another one. The feedforward runs once for it."""
    roles = standard_loop(prepared)
    if roles is None or not all(_is_covered(check, prepared, roles) for check in checks):
        return None
    if any(t.instance != roles.plant or not _varies(t.variable) for axis in axes for t in axis.targets):
        return None
    if any(axis.option for axis in axes) and not all(axis.targets or axis.option for axis in axes):
        return None
    kind, model = prepared.kinds[roles.plant], prepared.models[roles.plant]
    interface, data = kind.contents(prepared.design, model)
    fields = kind.require_native().data(interface, data)
    measures, rows, bands = _measures(checks, prepared, roles)
    x_ref, u_ff = _references(prepared, roles, files, library)
    task = BatchTask(
        plant=_plant(interface, fields),
        controller=_controller(prepared, roles),
        step=prepared.step,
        steps=prepared.steps,
        x_ref=x_ref,
        u_ff=u_ff,
        force=_force(prepared, roles),
        measures=rows,
        bands=bands,
    )
    base = np.array([own_start(v) for v in interface])
    for name, value in prepared.numeric_starts(roles.plant).items():
        base[interface.reference(name)] = value
    places = tuple(tuple((interface.reference(t.variable), t.factor) for t in axis.targets) for axis in axes)
    return BatchPlan(task=task, measures=measures, base=base, places=places)


def _varies(variable: str) -> bool:
    """Whether the kernel takes a parameter of the plant sample by sample."""
    return "]." in variable or variable in ("strain_noise_std", "noise_seed")


def _signal(check: Check, roles: Roles) -> tuple[int, str] | None:
    """The number of a measured signal, and its name at the plant; None for one that the kernel does not have."""
    owner, _, name = check.of.partition(".")
    array = name.partition("[")[0]
    if (owner == roles.plant and array in SIGNALS) or (owner == roles.controller and array == "u"):
        return SIGNALS.index(array), name
    return None


def _is_covered(check: Check, prepared: PreparedScenario, roles: Roles) -> bool:
    moving = check.reference in ("end", "start") and check.measure in SETTLING
    return check.measure in COVERED and not moving and _signal(check, roles) is not None


def _measures(
    checks: Sequence[Check], prepared: PreparedScenario, roles: Roles
) -> tuple[tuple[BatchMeasure, ...], NDArray[np.int64], Array]:
    """The measures, and of all their elements the rows that the kernel takes, see batch.h."""
    columns = prepared.wiring.columns
    time = step_times(np.arange(prepared.steps + 1), prepared.step)
    zeros = Recording(
        time=time, columns=columns, values=np.broadcast_to(0.0, (len(time), len(columns))), wall_seconds=0.0
    )
    measures: list[BatchMeasure] = []
    rows: list[list[int]] = []
    bands: list[list[float]] = []
    for check in checks:
        found = _signal(check, roles)
        assert found is not None
        window, reference, factor = Measurement(prepared.scenario, "", zeros, None).layout(check)
        names = [columns[k] for k in window.columns]
        share = (
            np.abs(reference) if check.measure == "settling_time" else np.full(len(names), np.max(np.abs(reference)))
        )
        changes, banded = check.measure == "largest_change", check.measure in SETTLING
        first = len(rows)
        for name, middle, size in zip(names, reference.tolist(), share.tolist(), strict=True):
            element = element_names(dict.fromkeys(columns), name.partition("[")[0]).index(name)
            rows.append([found[0], element, window.first, window.stop - 1, int(changes), int(banded)])
            bands.append([middle, check.share * size])
        elements = slice(first, len(rows))
        measures.append(BatchMeasure(check=check, elements=elements, reference=reference, factor=factor))
    return tuple(measures), np.array(rows, dtype=np.int64), np.array(bands)


def _plant(interface: Interface, fields: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of BatchPlant from those of BeamPlantData."""
    points, gauges = int(fields["points"]), int(fields["gauges"])
    matrices = {"MASS": 0, "DAMPING": 1, "STIFFNESS": 2, "INPUT_GAIN": 3}
    return {
        **{name: int(fields[name]) for name in ("coordinates", "patches", "beams")},
        "points": points,
        "gauges": gauges,
        "value_count": len(tuple(interface)),
        "parameters": np.array([[r["reference"], int(r["may_vanish"])] for r in fields["parameters"].rows]),
        "terms": np.array(
            [
                [r["parameter"], matrices[r["matrix"]], r["column"], r["size"], r["rows"], r["block"]]
                for r in fields["terms"].rows
            ]
        ),
        "rows": fields["rows"].values,
        "blocks": fields["blocks"].values,
        **_without_stations(fields["outputs"], points + gauges, int(fields["beams"])),
        **{name: int(fields[name]) for name in ("start_at_rest_under", "strain_noise_std", "noise_seed")},
    }


def _without_stations(outputs: Mapping[str, Any], first: int, beams: int) -> dict[str, Any]:
    """The first rows of SparseRows and those of the tips, which are the last."""
    starts = np.asarray(outputs["starts"].values, dtype=np.int64)
    left_out = slice(starts[first], starts[-1 - beams])
    return {
        "starts": np.concatenate([starts[: first + 1], starts[-beams:] - (left_out.stop - left_out.start)]),
        **{name: np.delete(outputs[name].values, left_out) for name in ("columns", "values")},
    }


def _controller(prepared: PreparedScenario, roles: Roles) -> dict[str, Any]:
    """The fields of BatchController."""
    kind, model = prepared.kinds[roles.controller], prepared.models[roles.controller]
    interface, data = kind.contents(prepared.design, model)
    own = {v.name: own_start(v) for v in interface}
    starts = {**own, **{name: float(value) for name, value in prepared.numeric_starts(roles.controller).items()}}
    pairs = len(interface.references("u"))
    limit = starts["voltage_limit"]
    lowest, highest = np.full(pairs, -limit), np.full(pairs, limit)
    for k in range(pairs):  # limits of each pair, where the unit has them
        lowest[k] = max(lowest[k], starts.get(f"voltage_min[{k + 1}]", -limit))
        highest[k] = min(highest[k], starts.get(f"voltage_max[{k + 1}]", limit))
    return {
        "states": len(data.arrays["filter"]),
        "reduced_states": len(interface.references("x_est")),
        "filter": data.arrays["filter"],
        "regulator": data.arrays["regulator"],
        "integral_range": data.arrays["integral_range"],
        "integral_gain": starts["integral_gain"],
        "strain_limit": starts["strain_limit"],
        "lowest": lowest,
        "highest": highest,
    }


def _references(
    prepared: PreparedScenario, roles: Roles, files: Mapping[str, Path], library: Path
) -> tuple[Array, Array]:
    """x_ref and u_ff of every step, from a run of the units."""
    sources = prepared.wiring.sources
    outputs = prepared.declarations[roles.feedforward].variables
    names = [f"{roles.feedforward}.{n}" for array in ("x_ref", "u_ff") for n in element_names(outputs, array)]
    run = lean(prepared)
    recorded = replace(
        run.wiring, columns=names, recorded=[sources[n] for n in names], converted_columns={}, deflections=[]
    )
    with RepeatedRun(replace(run, wiring=recorded, scenario=replace(run.scenario, sensor=[])), files, library) as loop:
        recording = loop.run({})
    if recording.failure is not None:
        raise recording.failure
    count = len(element_names(outputs, "x_ref"))
    values = np.array(recording.values)
    return values[:, :count], values[:, count:]


def _force(prepared: PreparedScenario, roles: Roles) -> Array | None:
    """Forces on the tips at every step; None where there are none."""
    inputs = dict(prepared.wiring.inputs[roles.plant])
    names = element_names(prepared.declarations[roles.plant].variables, "force")
    time = np.arange(prepared.steps + 1, dtype=np.float64) * prepared.step
    force = np.zeros((prepared.steps + 1, len(names)))
    for span, signal in prepared.wiring.external:
        for column, name in enumerate(names):
            index = inputs.get(name, -1)
            if not isinstance(signal, float) and span.start <= index < span.stop:
                values = signal.sample(time)
                force[:, column] = values[:, index - span.start if values.shape[1] > 1 else 0]
    return force if np.any(force) else None
