"""The transitions of a design, and what its planner looks at, as fields of FlatnessFeedforwardData."""

import math

import numpy as np

from flexbeams.controller.planner import MOST_CANDIDATES, PLANNING_TICKS, sample_grid
from flexbeams.controller.spline_transitions import FREE, PLANNED_EXCESS, sample_points
from flexbeams.fmus.units.native_kernel import NATIVE, Fields, Table, UnitData, header_constant

SLOTS = header_constant(NATIVE / "units" / "motion.h", "SLOTS")  # transitions in progress at once

# arrays of a design, by its planner
MOTION_ARRAYS = {
    "paper": (
        "flat_ratios",
        "mode_series",
        "mode_inputs",
        "mode_states",
        "shape_times",
        "shape_values",
        "transition_table",
        "transition_constants",
    ),
    "multi_input": ("spline_times", "spline_points", "spline_eigenvalues", "spline_inputs", "spline_states"),
}


def motion_fields(data: UnitData) -> Fields:
    """The fields flat and splines, and those of the planner."""
    if data.meta["planner"] == "paper":
        return {
            "flat": _flat_output(data),
            "planning_ticks": float(PLANNING_TICKS),
            "planned_excess": 0.0,
            **_curves(data),
        }
    inverse, states = data.arrays["static_inverse"], len(data.arrays["spline_states"])
    return {
        "flat": {"voltages": len(inverse), "states": states},
        "splines": _splines(data),
        "planning_ticks": float(PLANNING_TICKS),
        "planned_excess": PLANNED_EXCESS,
        **_spline_curves(data),
    }


def portion_fields(candidates: int, intervals: int, look: float, candidate: float) -> Fields:
    """Work of a tick that suffices for any plan, and what it counts, in units of one transition at one time.

    A bisection of so many durations looks at each transition's times, at all transitions there; a time takes `look`
    and a duration `candidate` besides.
    """
    tried = 2 + math.ceil(math.log2(candidates))
    work = tried * (SLOTS * (intervals + 1) * (SLOTS + look) + candidate)
    return {
        "planning_portion": float(math.ceil(work / PLANNING_TICKS)),
        "look_work": look,
        "candidate_work": candidate,
    }


def _flat_output(data: UnitData) -> Fields:
    """The fields of FlatOutput: what gives voltages and states, and Theta."""
    arrays = data.arrays
    (states, width), (_, voltages) = arrays["mode_states"].shape, arrays["mode_inputs"].shape
    degree, nodes = len(arrays["flat_ratios"]), len(arrays["transition_table"]) - 1
    exponent, norm = arrays["transition_constants"].tolist()
    return {
        "voltages": voltages,
        "states": states,
        "degree": degree,
        "modes": width // 2,
        "ratios": Table(
            values=arrays["flat_ratios"],
            comment=f"(i + 1) c_(i+1) / c_i of u = sum_i c_i xi^(i) (31), c_0 = 1, ({degree},), s",
        ),
        "mode_series": Table(
            values=arrays["mode_series"],
            comment=f"D_l,i / c_i of each mode (34), real before imaginary parts, ({width}, {degree}), 1",
            in_panels=True,
        ),
        "mode_inputs": Table(
            values=arrays["mode_inputs"],
            comment=f"amplitudes of the modes for voltages at rest, likewise, ({width}, {voltages}), 1/V",
            in_panels=True,
        ),
        "mode_states": Table(
            values=arrays["mode_states"],
            comment=f"x_ref for amplitudes of the modes, likewise, ({states}, {width}), 1",
            in_panels=True,
        ),
        "transition": {
            "exponent": exponent,
            "norm": norm,
            "nodes": nodes,
            "table": Table(
                values=arrays["transition_table"],
                comment=f"Theta(i / {nodes}) of (37), i = 0 ... {nodes}, ({nodes + 1},), 1",
            ),
        },
    }


def _splines(data: UnitData) -> Fields:
    """The fields of SplineTransitions."""
    arrays = data.arrays
    (states, width), (_, voltages) = arrays["spline_states"].shape, arrays["spline_inputs"].shape
    times, count = arrays["spline_times"], len(arrays["spline_times"])
    return {
        "voltages": voltages,
        "states": states,
        "modes": width // 2,
        "durations": count,
        "times": Table(
            values=times,
            comment=f"transition times, ({count},), s",
            decimals={"transition times, s": times[None]},
        ),
        "points": Table(
            values=arrays["spline_points"].ravel(),
            comment="free control points of each transition time, by 1 V more at each pair, of all pairs, "
            f"({count}, {voltages}, {FREE}, {voltages}), 1",
        ),
        "eigenvalues": Table(
            values=arrays["spline_eigenvalues"],
            comment=f"of the modes, real before imaginary parts, ({width},), 1/s",
        ),
        "mode_inputs": Table(
            values=arrays["spline_inputs"],
            comment=f"beta of y' = lambda y + beta u, likewise, ({width}, {voltages}), 1/(V s)",
            in_panels=True,
        ),
        "mode_states": Table(
            values=arrays["spline_states"],
            comment=f"x_ref for amplitudes of the modes, likewise, ({states}, {width}), 1",
            in_panels=True,
        ),
    }


def _curves(data: UnitData) -> Fields:
    """The voltage over a transition, by which the planner judges transition times."""
    durations, curves = data.arrays["shape_times"], data.arrays["shape_values"]
    count, intervals = len(curves), curves.shape[1] - 1
    return {
        "durations": count,
        "intervals": intervals,
        # the range of the voltages takes as long as some 2 transitions and another one for 6 pairs
        **portion_fields(MOST_CANDIDATES, intervals, look=2 + len(data.arrays["static_inverse"]) / 6, candidate=0.0),
        "curve_durations": Table(
            values=durations,
            comment=f"transition times of the voltage curves, ({count},), s",
            decimals={"transition times, s": durations[None]},
        ),
        "curve_grid": Table(
            values=sample_grid(intervals), comment=f"t / T at which the voltage curves are given, ({intervals + 1},), 1"
        ),
        "curve_rates": Table(
            values=1 / np.diff(sample_grid(intervals)), comment=f"reciprocals of their distances, ({intervals},), 1"
        ),
        "curves": Table(
            values=curves,
            comment=f"voltage per change of the flat output, a row for each transition time, "
            f"({count}, {intervals + 1}), 1",
        ),
    }


def _spline_curves(data: UnitData) -> Fields:
    """The times at which the planner looks at a spline."""
    tau, count = sample_points(), len(data.arrays["spline_times"])
    pairs = len(data.arrays["static_inverse"])
    return {
        "durations": count,
        "intervals": len(tau) - 1,
        # the control points of a duration take as long as some 7 transitions for each pair
        **portion_fields(count, len(tau) - 1, look=1.0, candidate=7.0 * pairs),
        "curve_grid": Table(values=tau, comment=f"t / T at which the planner looks at splines, ({len(tau)},), 1"),
    }
