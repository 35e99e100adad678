"""Static gains that a design assumes: of its own basis, of the exact plant, or measured on the rig."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from flexbeams.controller.options import DesignOptions
from flexbeams.controller.reduction import ReducedModel
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError, InputError
from flexbeams.plant.galerkin import BeamModel, beam_model
from flexbeams.plant.statespace import static_gains
from flexbeams.plant.static_maps import read_static_maps


@dataclass(frozen=True, kw_only=True)
class Statics:
    """Gains at rest from u, and the model that says how they depend on the parameters."""

    deflection: Array  # G_pi (n_pi, n_u), m/V
    strain: Array  # G_pm (n_pm, n_u), 1/V
    stations: Array  # (r STATIONS, n_u), m/V
    model: BeamModel


def statics_of(model: BeamModel, options: DesignOptions) -> Statics:
    """The statics that static_maps chooses; `model` is the design's own. Raises DesignError for an unreadable file."""
    source = model if options.static_maps == "basis" else beam_model(model.structure, "segment")
    system = source.assemble()
    deflection, strain = static_gains(source, system)
    stations = source.stations.reshape(-1, source.size) @ np.linalg.solve(system.K, system.L)
    if options.static_maps not in ("basis", "segment"):
        try:
            measured = read_static_maps(
                Path(options.static_maps), pairs=deflection.shape[1], points=len(deflection), gauges=len(strain)
            )
        except InputError as error:
            raise DesignError(f"static_maps: {error}") from None
        deflection, strain = measured.deflection, measured.strain
    return Statics(deflection=deflection, strain=strain, stations=stations, model=source)


def with_statics(reduced: ReducedModel, statics: Statics) -> ReducedModel:
    """The reduced model with direct terms D_0 = G - G_reduced that give it these statics."""
    rest = -np.linalg.solve(reduced.A, reduced.B)
    return replace(
        reduced,
        D_pi=statics.deflection - reduced.H_pi @ rest,
        D_pm=statics.strain - reduced.H_pm @ rest,
        D_w=statics.stations - reduced.H_w @ rest,
    )
