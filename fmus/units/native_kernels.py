"""The C kernels of the units, and their data from what a design computes."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexbeams.controller.observer import tick_matrices
from flexbeams.controller.planner import sample_grid
from flexbeams.fmus.errors import BuildError
from flexbeams.fmus.interface.variables import Interface
from flexbeams.fmus.units.kernels import NATIVE, Data, Fields, Kernel, Records, Table, first_references

_MATRICES = {"M": "MASS", "D": "DAMPING", "K": "STIFFNESS", "L": "INPUT_GAIN"}
_PLANT_REFERENCES = ("u", "force", "y_pi", "energy", "start_at_rest_under", "strain_noise_std", "noise_seed")
_FEEDFORWARD_REFERENCES = (
    *("y_target", "u_ff", "x_ref", "y_ref", "moving", "target_refused"),
    *("planned_time", "planned_peak", "transition_time", "voltage_limit", "preview"),
)
_CONTROLLER_REFERENCES = (
    *("y_pm", "u_ff", "x_ref", "u", "y_est", "saturated"),
    *("x_est", "feedback", "integral_gain", "voltage_limit"),
)


def kernel_of(unit: str) -> Kernel:
    """The kernel of a unit; BuildError for a name that no native unit has."""
    if unit not in KERNELS:
        raise BuildError(f"{unit}: there is no native unit of this name")
    return KERNELS[unit]


def _plant(interface: Interface, data: Data, meta: Mapping[str, Any]) -> Fields:
    n, beams = int(meta["size"]), len(data["tips"])
    points, gauges, stations = (len(interface.references(name)) for name in ("y_pi", "y_pm", "w"))
    blocks = [data[f"term_{k}"] for k in range(len(meta["terms"]))]
    starts = np.cumsum([0, *(block.size for block in blocks)]).tolist()
    terms = [
        {
            "parameter": meta["parameters"][name],
            "matrix": _MATRICES[matrix],
            "start": start,
            "column": column,
            "size": len(block),
            "block": begin,
        }
        for (name, matrix, start, column), block, begin in zip(meta["terms"], blocks, starts, strict=False)
    ]
    parameters = [
        {"reference": reference, "may_vanish": name in meta["may_vanish"]}
        for name, reference in meta["parameters"].items()
    ]
    return {
        "coordinates": n,
        "patches": len(interface.references("u")),
        "beams": beams,
        "points": points,
        "gauges": gauges,
        "stations": stations,
        "parameter_count": len(parameters),
        "term_count": len(terms),
        **first_references(interface, *_PLANT_REFERENCES),
        "parameters": Records(
            type="PlantParameter", rows=parameters, comment="the physical parameters, by value reference"
        ),
        "terms": Records(
            type="PlantTerm", rows=terms, comment="what each parameter adds to the matrices of M q'' + D q' + K q = L u"
        ),
        "blocks": Table(
            values=np.concatenate([block.ravel() for block in blocks]),
            comment="the blocks of the terms one after the other, each row by row, for a parameter of 1 in SI units",
        ),
        "tips": Table(values=data["tips"], comment=f"deflection of each tip per coordinate, ({beams}, {n}), 1"),
        "outputs": Table(
            values=data["outputs"],
            comment=f"per coordinate, ({points + gauges + stations}, {n}): deflections y_pi, 1, strains y_pm, 1/m, "
            "deflections w of the stations, 1",
        ),
    }


def _feedforward(interface: Interface, data: Data, meta: Mapping[str, Any]) -> Fields:
    inverse = data["static_inverse"]
    (voltages, points), states = inverse.shape, len(data["state_series"])
    degree = len(data["input_series"]) - 1
    return {
        "voltages": voltages,
        "states": states,
        "points": points,
        "degree": degree,
        "durations": len(data["shape_values"]),
        "intervals": data["shape_values"].shape[1] - 1,
        **first_references(interface, *_FEEDFORWARD_REFERENCES),
        "transition": _transition(data),
        "input_series": Table(
            values=data["input_series"],
            comment=f"c_i of u = sum_i c_i xi^(i) (31), i = 0 ... {degree}, ({degree + 1},), s^i",
        ),
        "state_series": Table(
            values=data["state_series"].reshape(states, -1),
            comment=f"X_i of x_ref = sum_i X_i xi^(i), side by side, ({states}, {degree} x {voltages}), s^i/V",
            in_panels=True,
        ),
        "static_inverse": Table(
            values=inverse,
            comment=f"G_0^+, from deflections to voltages at rest, ({voltages}, {points}), V/m",
            in_panels=True,
            decimals={"G_0^+, V/m": inverse},
        ),
        "reference_outputs": Table(
            values=np.hstack([data["H_pi"], data["D_pi"]]),
            comment=f"[H_pi, D_pi] of y_ref, ({points}, {states} + {voltages}), m and m/V",
            in_panels=True,
        ),
        **_voltage_curves(data["shape_times"], data["shape_values"]),
    }


def _transition(data: Data) -> Fields:
    """The struct Transition of native/units/transition.h."""
    exponent, norm = data["transition_constants"]
    nodes = len(data["transition_table"]) - 1
    return {
        "exponent": float(exponent),
        "norm": float(norm),
        "nodes": nodes,
        "table": Table(
            values=data["transition_table"],
            comment=f"Theta(i / {nodes}) of (37), i = 0 ... {nodes}, ({nodes + 1},), 1",
        ),
    }


def _voltage_curves(durations: NDArray[Any], curves: NDArray[Any]) -> Fields:
    count, intervals = len(curves), curves.shape[1] - 1
    return {
        "curve_durations": Table(
            values=durations,
            comment=f"transition times of the voltage curves, ({count},), s",
            decimals={"transition times, s": durations[None]},
        ),
        "curve_grid": Table(
            values=sample_grid(intervals), comment=f"t / T at which the voltage curves are given, ({intervals + 1},), 1"
        ),
        "curves": Table(
            values=curves,
            comment=f"voltage per change of the flat output, a row for each transition time, "
            f"({count}, {intervals + 1}), 1",
        ),
    }


def _controller(interface: Interface, data: Data, meta: Mapping[str, Any]) -> Fields:
    tick = tick_matrices(data)
    (states, gauges), (voltages, points) = data["estimator_gain"].shape, data["static_inverse"].shape
    return {
        "states": states,
        "voltages": voltages,
        "points": points,
        "gauges": gauges,
        "sample_time": float(meta["sample_time"]),
        **first_references(interface, *_CONTROLLER_REFERENCES),
        "filter": Table(
            values=tick.filter,
            comment=f"[A_d - L H_pm, B_d - L D_pm, L] of the Kalman filter (42), "
            f"({states}, {states} + {voltages} + {gauges})",
            in_panels=True,
            decimals={"estimator gain L, state per strain": data["estimator_gain"]},
        ),
        "regulator": Table(
            values=tick.regulator,
            comment=f"[K, 0; G_0^+ H_pi, G_0^+ D_pi] of (44) and (45), (2 x {voltages}, {states} + {voltages}), "
            "V per state and V/V",
            in_panels=True,
            decimals={"feedback gain K, V per state": data["feedback_gain"]},
        ),
        "estimates": Table(
            values=tick.estimates,
            comment=f"[H_pi, D_pi] of y_est, ({points}, {states} + {voltages}), m and m/V",
            in_panels=True,
        ),
    }


def _source(interface: Interface, data: Data, meta: Mapping[str, Any]) -> Fields:
    signals = meta["signals"]
    return {
        "signal_count": len(signals),
        "signals": Records(type="SourceSignal", rows=signals, comment="what drives the outputs"),
        "numbers": Table(
            values=data["numbers"] if data["numbers"].size else np.zeros(1),
            comment="tables of the signals, one after the other: times, s, then values, row by row",
        ),
        "bits": Table(
            values=data["bits"] if data["bits"].size else np.zeros(1, np.uint8),
            comment="levels of the binary sequences, eight in a byte",
        ),
    }


def _kernel(name: str, prefix: str, **more: Any) -> Kernel:
    return Kernel(source=NATIVE / "units" / f"{prefix}.c", data_type=f"{name}Data", hooks=f"{prefix}_hooks", **more)


KERNELS = {
    "BeamPlant": _kernel("BeamPlant", "beam_plant", data=_plant, deferred=("w", "energy"), interpolates_inputs=True),
    "FlatnessFeedforward": _kernel("FlatnessFeedforward", "flatness_feedforward", data=_feedforward),
    "TrackingController": _kernel("TrackingController", "tracking_controller", data=_controller),
    "SignalSource": _kernel("SignalSource", "signal_source", data=_source),
}
