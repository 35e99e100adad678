"""Reference results of FlatnessFeedforward: a sum over all transitions at any time, where the kernels retire them.

Transitions and planner are those of the Python kernel.
"""

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.controller.motion_model import motion_model
from flexbeams.controller.planner import PendingTransitions, plan_at_tick
from flexbeams.fmus.references.experiments import Experiment, Series, jumps, names_of
from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel


def feedforward_experiments(design: Design, model: BeamModel) -> list[Experiment]:
    """A transition to its end; another target on the way, seen ahead. Left out where the planner refuses a target."""
    options, inverse = design.options, design.arrays["static_inverse"]
    # powers of two: an importer that interpolates leaves them as they are, any change would be another target
    pattern = (-0.5) ** np.arange(inverse.shape[1])
    targets = np.stack([pattern, -0.5 * pattern[::-1]])
    targets = targets - targets @ design.arrays["unreachable"].T
    if not np.any(targets @ inverse.T):
        return []  # no pair moves a point of interest
    targets *= 2.0 ** np.floor(np.log2(0.4 * options.voltage_limit / np.max(np.abs(targets @ inverse.T))))
    experiments = [
        # it ends between two rows: at one, rounding would decide whether it is still moving
        _transitions(
            design,
            targets[:1],
            output_rows=36,
            rows_per_transition=32.5,
            name="transition",
            description="A transition to a target, to its end",
        ),
        _transitions(
            design,
            targets,
            output_rows=40,
            rows_per_transition=42.0,
            name="retarget",
            parameters={
                "transition_time": max(1e-3, float(f"{0.8 * options.transition_time:.4g}")),
                "preview": 5 * options.sample_time,
            },
            description="Another target on the way to the first, with a preview of five steps",
        ),
    ]
    return [experiment for experiment in experiments if experiment is not None]


def _transitions(
    design: Design,
    targets: Array,
    output_rows: int,
    rows_per_transition: float,
    name: str,
    description: str,
    parameters: dict[str, float | bool] | None = None,
) -> Experiment | None:
    """The first of targets (i, n_pi) in step 3, the second in row 16; None where the planner refuses one."""
    step, parameters = design.options.sample_time, parameters or {}
    requested = float(parameters.get("transition_time", design.options.transition_time))
    preview = float(parameters.get("preview", 0.0))
    first = feedforward_plan(design, [3], targets[:1], requested)
    stride = max(1, round(float(first.durations.sum()) / rows_per_transition / step))
    begins = [3, 16 * stride][: len(targets)]
    motion = feedforward_plan(design, begins, targets, requested)
    if len(motion.starts) < len(targets):
        return None
    ticks = stride * np.arange(output_rows + 1.0)
    values = [
        feedforward_outputs(design, motion, int(np.sum(motion.starts < (k - 0.5) * step)), k * step + preview)
        for k in ticks.tolist()
    ]
    n_u, n_pi = design.arrays["static_inverse"].shape
    outputs = (*names_of("u_ff", n_u), *names_of("x_ref", len(design.arrays["A"])), *names_of("y_ref", n_pi), "moving")
    return Experiment(
        name=name,
        description=description,
        step=step,
        steps=int(ticks[-1]),
        parameters=parameters,
        stimuli=jumps(
            tuple(names_of("y_target", n_pi)),
            step * np.array([0.0, *begins]),
            np.array([np.zeros(n_pi), *targets]),
            step * ticks[-1],
        ),
        references=Series(names=outputs, time=step * ticks, values=np.array(values)),
    )


def feedforward_plan(design: Design, seen: list[int], targets: Array, requested: float) -> PendingTransitions:
    """The motion from rest at 0 through targets (i, n_pi) seen at these ticks, without those that are refused."""
    inverse, curves, step = (
        design.arrays["static_inverse"],
        motion_model(design.arrays).curves,
        design.options.sample_time,
    )
    limits = design.options.voltage_limits(len(inverse))
    motion = PendingTransitions(
        offset=np.zeros(len(inverse)), starts=np.zeros(0), durations=np.zeros(0), changes=np.zeros((0, len(inverse)))
    )
    for tick, target in zip(seen, targets, strict=True):
        change = inverse @ target - motion.changes.sum(axis=0)
        start, plan = plan_at_tick(
            motion,
            curves,
            tick=tick,
            sample_time=step,
            change=change,
            requested=requested,
            limit=limits,
        )
        if plan.duration > 0:
            motion = motion.with_transition(start * step, plan.duration, change)
    return motion


def feedforward_outputs(design: Design, motion: PendingTransitions, begun: int, time: float) -> Array:
    """u_ff, x_ref, y_ref and moving (0 or 1) at `time` (s), of the first `begun` transitions, (n_u + m + n_pi + 1,)."""
    arrays = design.arrays
    begun_motion = PendingTransitions(
        offset=motion.offset,
        starts=motion.starts[:begun],
        durations=motion.durations[:begun],
        changes=motion.changes[:begun],
    )
    u, x = motion_model(arrays).references(begun_motion, time)
    moving = bool(np.any(time < motion.starts[:begun] + motion.durations[:begun]))
    return np.concatenate([u, x, arrays["H_pi"] @ x + arrays["D_pi"] @ u, [moving]])
