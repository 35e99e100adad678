"""The data of a native unit as C source: constant tables, doubles in hexadecimal, which compilers read alike."""

import hashlib
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexbeams.controller.planner import sample_grid
from flexbeams.fmus.errors import BuildError
from flexbeams.fmus.interface.variables import Interface, Variable

NAME_SIZE, TEXT_SIZE, PANEL = 48, 256, 8  # as in unit.h and linear_algebra.h
_TYPES = ("Real", "Integer", "Boolean", "String")
_CAUSALITIES = ("independent", "parameter", "input", "output", "local")
DEFERRED = {"BeamPlant": ("w", "energy")}  # computed when they are read
_MAY_VANISH = ("tip_mass", "viscous_damping", "structural_damping")

Data = Mapping[str, NDArray[Any]]


def tables_source(interface: Interface, data: Mapping[str, ArrayLike], meta: Mapping[str, Any], guid: str) -> str:
    """The file tables.c of a unit: what unit.h declares and what the header of its mathematics declares.

    `data` and `meta` are those of fmus.data.unit_data, of SignalSource those of fmus.signal_source.source_data.
    """
    unit = interface.unit_name
    return c_source(
        f"the tables of {unit}",
        f'#include "{header_of(unit)}"',
        "",
        *interface_tables(interface, guid, DEFERRED.get(unit, ())),
        *kernel_tables(interface, data, meta),
    )


def kernel_tables(interface: Interface, data: Mapping[str, ArrayLike], meta: Mapping[str, Any]) -> list[str]:
    """What the header of a unit's mathematics declares."""
    writers: dict[str, Callable[[Interface, Data, Mapping[str, Any]], list[str]]] = {
        "BeamPlant": _plant,
        "FlatnessFeedforward": _feedforward,
        "TrackingController": _controller,
        "SignalSource": _source,
    }
    return writers[interface.unit_name](interface, {name: np.asarray(values) for name, values in data.items()}, meta)


def header_of(unit: str) -> str:
    """The header of a unit's mathematics."""
    return {
        "BeamPlant": "beam_plant.h",
        "FlatnessFeedforward": "flatness_feedforward.h",
        "TrackingController": "tracking_controller.h",
        "SignalSource": "signal_source.h",
    }[unit]


def panels(matrix: ArrayLike) -> NDArray[np.float64]:
    """A matrix (rows, columns) as linear_algebra.h stores it: panels of 8 rows, each column by column."""
    rows = np.asarray(matrix, dtype=np.float64)
    padded = np.zeros((-(-len(rows) // PANEL) * PANEL, rows.shape[1]))
    padded[: len(rows)] = rows
    return padded.reshape(-1, PANEL, rows.shape[1]).transpose(0, 2, 1).ravel()


def interface_tables(interface: Interface, guid: str, deferred: Collection[str]) -> list[str]:
    """What unit.h declares; arrays that are `deferred` are computed when they are read."""
    texts: list[str] = []
    kinds, variables = [], []
    for variable in interface:
        start = variable.start
        if variable.type == "String":
            if variable.causality in ("parameter", "input"):
                raise BuildError(f"{interface.unit_name}: {variable.name} must be constant, as all native texts")
            texts.append(str(start or ""))
            start = len(texts) - 1
        kinds.append(_kind(variable, variable.array in deferred))
        low = -math.inf if variable.minimum is None else variable.minimum
        high = math.inf if variable.maximum is None else variable.maximum
        variables.append(
            f"{{.start = {c_real(start or 0.0)}, .minimum = {c_real(low)}, .maximum = {c_real(high)}, "
            f".name = {c_text(variable.name, NAME_SIZE)}}}"
        )
    digest = hashlib.sha256(guid.encode()).digest()
    return [
        f"const size_t unit_variable_count = {len(variables)};",
        f"const char unit_guid[] = {c_text(guid, TEXT_SIZE)};",
        f"const double unit_step_size = {c_real(interface.step_size)};",
        f"const bool unit_interpolates_inputs = {'true' if interface.can_interpolate_inputs else 'false'};",
        c_list("unsigned char unit_digest[DIGEST_SIZE]", [str(byte) for byte in digest], 16),
        c_list("unsigned char unit_kinds[]", [str(kind) for kind in kinds], 24),
        c_list("char unit_texts[][TEXT_SIZE]", [c_text(text, TEXT_SIZE) for text in texts or [""]], 1),
        c_list("variable unit_variables[]", variables, 1),
    ]


def _kind(variable: Variable, deferred: bool) -> int:
    kind = _TYPES.index(variable.type) | _CAUSALITIES.index(variable.causality) << 2
    return kind | 32 * (variable.variability == "fixed") | 64 * deferred


def _plant(interface: Interface, data: Data, meta: Mapping[str, Any]) -> list[str]:
    n, patches = int(meta["size"]), len(interface.references("u"))
    blocks = [data[f"term_{k}"] for k in range(len(meta["terms"]))]
    positions = np.cumsum([0, *(block.size for block in blocks)])
    placed = zip(meta["terms"], blocks, positions[:-1], strict=True)
    terms = [
        f"{{.parameter = {meta['parameters'][name]}, .matrix = '{matrix}', .start = {start}, .column = {column}, "
        f".size = {len(block)}, .block = {position}}}"
        for (name, matrix, start, column), block, position in placed
    ]
    parameters = [
        f"{{.reference = {reference}, .may_vanish = {'true' if name.endswith(_MAY_VANISH) else 'false'}}}"
        for name, reference in meta["parameters"].items()
    ]
    counts = {
        "coordinates": n,
        "patches": patches,
        "beams": len(data["tips"]),
        "points": len(interface.references("y_pi")),
        "gauges": len(interface.references("y_pm")),
        "stations": len(interface.references("w")),
        "parameters": len(parameters),
        "terms": len(terms),
    }
    references = ("u", "force", "y_pi", "energy", "start_at_rest_under", "strain_noise_std", "noise_seed")
    return [
        _table("plant_table plant", interface, counts, references),
        c_list("plant_parameter plant_parameters[]", parameters, 1),
        c_list("plant_term plant_terms[]", terms, 1),
        _reals("plant_blocks", np.concatenate([block.ravel() for block in blocks])),
        _reals("plant_tips", data["tips"]),
        _reals("plant_outputs", data["outputs"]),
    ]


def _feedforward(interface: Interface, data: Data, meta: Mapping[str, Any]) -> list[str]:
    inverse, values = data["static_inverse"], data["shape_values"]
    degree, states = len(data["input_series"]) - 1, len(data["state_series"])
    exponent, norm = data["transition_constants"]
    intervals = values.shape[1] - 1
    counts = {
        "voltages": inverse.shape[0],
        "states": states,
        "points": inverse.shape[1],
        "degree": degree,
        "exponent": float(exponent),
        "norm": float(norm),
        "nodes": len(data["transition_table"]) - 1,
        "shapes": len(values),
        "intervals": intervals,
    }
    references = (
        "y_target",
        "u_ff",
        "x_ref",
        "y_ref",
        "moving",
        "target_refused",
        "planned_time",
        "planned_peak",
        "transition_time",
        "voltage_limit",
        "preview",
    )
    return [
        _table("feedforward_table feedforward", interface, counts, references),
        _reals("input_series", data["input_series"]),
        _reals("state_series", panels(data["state_series"].reshape(states, -1))),
        _reals("static_inverse", panels(inverse)),
        _reals("reference_outputs", panels(np.hstack([data["H_pi"], data["D_pi"]]))),
        _reals("transition_table", data["transition_table"]),
        _reals("shape_times", data["shape_times"]),
        _reals("shape_places", sample_grid(intervals)),
        _reals("shape_values", values),
    ]


def _controller(interface: Interface, data: Data, meta: Mapping[str, Any]) -> list[str]:
    gain, feedback, inverse = data["estimator_gain"], data["feedback_gain"], data["static_inverse"]
    outputs = np.hstack([data["H_pi"], data["D_pi"]])
    voltages, points = inverse.shape
    estimator = np.hstack([data["A_d"] - gain @ data["H_pm"], data["B_d"] - gain @ data["D_pm"], gain])
    regulator = np.vstack([np.hstack([feedback, np.zeros((voltages, voltages))]), inverse @ outputs])
    counts = {
        "states": len(gain),
        "voltages": voltages,
        "points": points,
        "gauges": gain.shape[1],
        "sample_time": float(meta["sample_time"]),
    }
    references = (
        "y_pm",
        "u_ff",
        "x_ref",
        "u",
        "y_est",
        "saturated",
        "x_est",
        "feedback",
        "integral_gain",
        "voltage_limit",
    )
    return [
        _table("controller_table controller", interface, counts, references),
        _reals("controller_filter", panels(estimator)),
        _reals("controller_regulator", panels(regulator)),
        _reals("controller_estimates", panels(outputs)),
    ]


def _source(interface: Interface, data: Data, meta: Mapping[str, Any]) -> list[str]:
    signals = [
        "{" + ", ".join(f".{name} = {value}" + "u" * (name == "seed") for name, value in entry.items()) + "}"
        for entry in meta["signals"]
    ]
    bits = data["bits"].tolist() or [0]
    return [
        f"const size_t source_count = {len(signals)};",
        c_list("source_signal source_signals[]", signals, 1),
        _reals("source_numbers", data["numbers"] if data["numbers"].size else np.zeros(1)),
        c_list("unsigned char source_bits[]", [str(byte) for byte in bits], 24),
    ]


def _table(
    declaration: str, interface: Interface, numbers: Mapping[str, int | float], references: Sequence[str]
) -> str:
    values = {name: c_real(number) if isinstance(number, float) else str(number) for name, number in numbers.items()}
    values |= {name: str(interface.references(name).start) for name in references}
    return c_list(declaration, [f".{name} = {value}" for name, value in values.items()], 1)


def _reals(name: str, values: ArrayLike) -> str:
    numbers = np.asarray(values, dtype=np.float64).ravel()
    if not np.isfinite(numbers).all():
        raise BuildError(f"{name} must be finite")
    return c_list(f"double {name}[]", [c_real(value) for value in numbers.tolist()], 6)


def c_source(about: str, *parts: str) -> str:
    """A generated file, its first line says what it holds."""
    return "\n".join([f"/* Generated: {about}. */", "", "#include <math.h>", "", *parts])


def c_list(declaration: str, items: Sequence[str], in_a_line: int) -> str:
    """A constant with its values."""
    lines = ["    " + ", ".join(items[k : k + in_a_line]) + "," for k in range(0, len(items), in_a_line)]
    return "\n".join([f"const {declaration} = {{", *lines, "};", ""])


def c_real(value: Any) -> str:
    """A double with all its digits."""
    number = float(value)
    return number.hex() if math.isfinite(number) else "HUGE_VAL" if number > 0 else "-HUGE_VAL"


def c_text(text: str, size: int) -> str:
    """A string of fewer than `size` characters; BuildError for one that is longer or not plain."""
    if not text.isascii() or not text.isprintable() or len(text) >= size or set(text) & set('"\\?'):
        raise BuildError(f"{text!r} must be plain ASCII of fewer than {size} characters")
    return f'"{text}"'
