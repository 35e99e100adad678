"""Short experiments for each unit and what must come out of them: the reference results that a unit carries."""

from dataclasses import dataclass, field

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.fmus.references.responses import controller_response, feedforward_outputs, held_response, planned_motion
from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel


@dataclass(frozen=True, kw_only=True)
class Series:
    """Values of variables at some times; two rows of one time are a jump."""

    names: tuple[str, ...]
    time: Array  # (k,), s
    values: Array  # (k, len(names))


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A run from 0 s by equal steps, and what comes out of it.

    Inputs are held over a step at their value at its beginning, those without stimuli at their start values. A row of
    `references` is the value once the step up to its time is done, or after the initialisation.
    """

    name: str
    description: str
    step: float  # s
    steps: int
    parameters: dict[str, float | bool] = field(default_factory=dict)  # unlike the unit's own
    stimuli: Series | None = None
    references: Series


def experiments(unit_name: str, design: Design, model: BeamModel) -> list[Experiment]:
    """Those of a unit with the start values of its design; none for a unit that is not known here."""
    if unit_name == "BeamPlant":
        return plant_experiments(design, model)
    if unit_name == "FlatnessFeedforward":
        return feedforward_experiments(design)
    return controller_experiments(design) if unit_name == "TrackingController" else []


def names_of(array: str, size: int) -> list[str]:
    """name[1] .. name[size]."""
    return [f"{array}[{k}]" for k in range(1, size + 1)]


def plant_experiments(design: Design, model: BeamModel) -> list[Experiment]:
    """Voltages step and pushes at the tips; a release of a structure that is not the design's."""
    step, structure = design.options.sample_time, model.structure
    every = max(1, round(0.002 / step))
    rows = every * np.arange(101.0)
    n_u, r = len(structure.patch), len(structure.beam)
    names = (*names_of("y_pi", len(model.deflection)), *names_of("y_pm", len(model.strain)))
    voltage = _alternating(n_u, 0.4 * design.options.voltage_limit)
    inputs = np.zeros((4, n_u + r))
    inputs[1:, :n_u] = voltage
    inputs[2, n_u:] = _alternating(r, 0.05)
    starts = every * np.array([0.0, 1.0, 50.0, 52.0])
    moving = held_response(
        model.assemble(), np.vstack([model.deflection, model.strain]), step * starts, inputs, step * rows
    )
    changed = _changed(structure.parameters())
    released = held_response(
        model.assemble(changed),
        np.vstack([model.deflection, model.strain]),
        np.zeros(1),
        np.zeros((1, n_u + r)),
        step * rows,
        at_rest_under=voltage,
    )
    return [
        Experiment(
            name="step_and_push",
            step=step,
            steps=int(rows[-1]),
            description="Voltages step, then the tips are pushed for a moment",
            stimuli=_jumps((*names_of("u", n_u), *names_of("force", r)), step * starts, inputs, step * rows[-1]),
            references=Series(names=names, time=step * rows, values=moving),
        ),
        Experiment(
            name="release",
            step=step,
            steps=int(rows[-1]),
            description="A structure with other parameters swings freely from rest under voltages",
            parameters={**changed, **dict(zip(names_of("start_at_rest_under", n_u), voltage.tolist(), strict=True))},
            references=Series(names=names, time=step * rows, values=released),
        ),
    ]


def _changed(parameters: dict[str, float]) -> dict[str, float]:
    """Every third parameter, by up to a fifth."""
    return {
        name: float(f"{value * (0.8 + 0.05 * (k % 9)):.4g}")
        for k, (name, value) in enumerate(parameters.items())
        if k % 3 == 0
    }


def feedforward_experiments(design: Design) -> list[Experiment]:
    """A transition to its end; another target on the way, seen ahead. Left out where the planner refuses a target."""
    options, inverse = design.options, design.arrays["static_inverse"]
    # powers of two: an importer that interpolates leaves them as they are, any change would be another target
    pattern = (-0.5) ** np.arange(inverse.shape[1])
    targets = np.stack([pattern, -0.5 * pattern[::-1]])
    targets *= 2.0 ** np.floor(np.log2(0.4 * options.voltage_limit / np.max(np.abs(targets @ inverse.T))))
    more = {
        "transition_time": max(1e-3, float(f"{0.8 * options.transition_time:.4g}")),
        "preview": 5 * options.sample_time,
    }
    found = [
        # it ends between two rows: at one, rounding would decide whether it is still moving
        _feedforward_run(
            design,
            targets[:1],
            rows=36,
            whole=32.5,
            name="transition",
            description="A transition to a target, to its end",
        ),
        _feedforward_run(
            design,
            targets,
            rows=40,
            whole=42.0,
            name="retarget",
            parameters=more,
            description="Another target on the way to the first, with a preview of five steps",
        ),
    ]
    return [experiment for experiment in found if experiment is not None]


def _feedforward_run(
    design: Design,
    targets: Array,
    rows: int,
    whole: float,
    name: str,
    description: str,
    parameters: dict[str, float | bool] | None = None,
) -> Experiment | None:
    """The first of targets (i, n_pi) in step 3, the second in row 16; `whole` rows are the first transition."""
    step, parameters = design.options.sample_time, parameters or {}
    wanted = float(parameters.get("transition_time", design.options.transition_time))
    preview = float(parameters.get("preview", 0.0))
    alone = planned_motion(design, [3 * step], targets[:1], wanted)
    every = max(1, round(float(alone.durations.sum()) / whole / step))
    begins = [3, 16 * every][: len(targets)]
    motion = planned_motion(design, [k * step for k in begins], targets, wanted)
    if len(motion.starts) < len(targets):
        return None
    ticks = every * np.arange(rows + 1.0)
    values = [
        feedforward_outputs(design, motion, sum(b < k for b in begins), k * step + preview) for k in ticks.tolist()
    ]
    n_u, n_pi = design.arrays["static_inverse"].shape
    outputs = (*names_of("u_ff", n_u), *names_of("x_ref", len(design.arrays["A"])), *names_of("y_ref", n_pi), "moving")
    return Experiment(
        name=name,
        description=description,
        step=step,
        steps=int(ticks[-1]),
        parameters=parameters,
        stimuli=_jumps(
            tuple(names_of("y_target", n_pi)),
            step * np.array([0.0, *begins]),
            np.array([np.zeros(n_pi), *targets]),
            step * ticks[-1],
        ),
        references=Series(names=outputs, time=step * ticks, values=np.array(values)),
    )


def controller_experiments(design: Design) -> list[Experiment]:
    """Measurements and references that swing, with the design's parameters and with a limit that is reached."""
    arrays, step, limit = design.arrays, design.options.sample_time, design.options.voltage_limit
    (n_u, m), n_pi, n_pm = arrays["feedback_gain"].shape, len(arrays["H_pi"]), len(arrays["H_pm"])
    names = (*names_of("y_pm", n_pm), *names_of("u_ff", n_u), *names_of("x_ref", m))
    reach = 0.3 * limit / float(np.max(np.abs(arrays["feedback_gain"]).sum(axis=1)))
    size = np.concatenate([np.full(n_pm, 1e-4), np.full(n_u, 0.6 * limit), np.full(m, reach)])
    k, column = np.arange(101.0)[:, None], np.arange(len(names))
    inputs = np.round(np.sin(2 * np.pi * k / (25 + 3 * (column % 17))), 3) * _digits(size, 1)
    stimuli = Series(names=names, time=step * k[:, 0], values=_digits(inputs, 4))
    outputs = (*names_of("u", n_u), *names_of("y_est", n_pi), "saturated")
    found = []
    for name, description, more in (
        ("swinging", "Measurements and references swing", {}),
        (
            "limited",
            "The same with a voltage limit that is reached, and a faster integral",
            {"integral_gain": 0.01, "voltage_limit": float(f"{0.4 * limit:.4g}")},
        ),
    ):
        values = controller_response(design, stimuli.values, **more)
        found.append(
            Experiment(
                name=name,
                description=description,
                step=step,
                steps=len(inputs) - 1,
                parameters=dict(more),
                stimuli=stimuli,
                references=Series(names=outputs, time=stimuli.time, values=values),
            )
        )
    return found


def _alternating(size: int, largest: float) -> Array:
    """(size,): largest, -largest / 2, largest / 3 ..."""
    return _digits(largest * (-1.0) ** np.arange(size) / np.arange(1, size + 1), 3)


def _digits(values: Array, count: int) -> Array:
    """Each value to some significant digits."""
    return np.array([float(f"{v:.{count}g}") for v in values.ravel()]).reshape(values.shape)


def _jumps(names: tuple[str, ...], starts: Array, inputs: Array, end: float) -> Series:
    """Inputs (i, n) that hold from starts (i,) s on, up to `end`."""
    time = np.concatenate([starts[:1], np.repeat(starts[1:], 2), [end]])
    return Series(names=names, time=time, values=np.repeat(inputs, 2, axis=0))
