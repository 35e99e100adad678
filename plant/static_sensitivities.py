"""How static gains depend on the physical parameters, to first order."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel


@dataclass(frozen=True, kw_only=True)
class StaticSensitivity:
    """Change of both static gains for the whole of one parameter: derivative times value."""

    deflection: Array  # (n_pi, n_u), m/V
    strain: Array  # (n_pm, n_u), 1/V


def static_sensitivities(model: BeamModel) -> dict[str, StaticSensitivity]:
    """Sensitivity of G = C K^-1 L for every parameter that statics depend on, at the structure's own values.

    p dG/dp = -C K^-1 (p dK/dp) K^-1 L + C K^-1 (p dL/dp); masses and damping have no part in it.
    """
    system = model.assemble()
    values = model.structure.parameters()
    outputs = np.vstack([model.deflection, model.strain])
    points = len(model.deflection)
    factor = cho_factor(system.K, lower=True)
    rest, adjoint = cho_solve(factor, system.L), cho_solve(factor, outputs.T)
    result = {}
    for term in model.terms:
        rows = slice(term.start, term.start + len(term.block))
        change = np.zeros((len(outputs), system.L.shape[1]))
        if term.matrix == "K":
            change = -adjoint[rows].T @ (values[term.parameter] * term.block) @ rest[rows]
        elif term.matrix == "L":
            change[:, term.column] = adjoint[rows].T @ (values[term.parameter] * term.block[:, 0])
        else:
            continue
        result[term.parameter] = StaticSensitivity(deflection=change[:points], strain=change[points:])
    return result
