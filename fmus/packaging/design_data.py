"""What each unit carries, from a design and the plant's model: arrays and plain values, for every kernel."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexbeams.controller.design import Design
from flexbeams.fmus.interface.variables import Interface
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.parameters import in_unit_order

_FEEDFORWARD = (
    "static_inverse",
    "input_series",
    "state_series",
    "shape_times",
    "shape_values",
    "transition_table",
    "transition_constants",
    "H_pi",
    "D_pi",
)
_CONTROLLER = ("A_d", "B_d", "H_pi", "H_pm", "D_pi", "D_pm", "estimator_gain", "feedback_gain", "static_inverse")


def unit_data(interface: Interface, design: Design, model: BeamModel) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Arrays and JSON values of a unit.

    BeamPlant: term_<k> (the Gram matrices of BeamModel.terms, listed in `terms` as parameter, matrix, start,
    column), tips (r, n) and outputs (n_pi + n_pm + r * stations, n) for y_pi, y_pm and w; `parameters` maps the
    physical parameters to value references, `may_vanish` lists those that can be 0. The other two: arrays of the
    design by their names.
    """
    meta: dict[str, Any] = {"sample_time": design.options.sample_time, "design_id": design.design_id}
    if interface.unit_name == "BeamPlant":
        parameters = dict(in_unit_order(model.structure.parameters()))
        arrays = {f"term_{k}": term.block for k, term in enumerate(model.terms)}
        arrays["tips"] = model.tips
        arrays["outputs"] = np.vstack([model.deflection, model.strain, model.stations.reshape(-1, model.size)])
        meta |= {
            "size": model.size,
            "basis": model.basis,
            "order": model.order,
            "terms": [[t.parameter, t.matrix, t.start, t.column] for t in model.terms],
            "parameters": {name: interface.reference(name) for name in parameters},
            "may_vanish": [name for name, entry in parameters.items() if entry.may_vanish],
        }
        return arrays, meta
    names = _FEEDFORWARD if interface.unit_name == "FlatnessFeedforward" else _CONTROLLER
    return {name: design.arrays[name] for name in names}, meta
