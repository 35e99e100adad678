"""What an experiment will tell of the parameters, before it is made: the exact Fisher information of its record."""

from dataclasses import dataclass

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.information import OPEN, Direction, open_directions
from flexbeams.plant.identification.residuals import Residuals, SensorModel
from flexbeams.plant.identification.scale import require_scale
from flexbeams.plant.identification.space import ParameterSpace


@dataclass(frozen=True, kw_only=True)
class Expectation:
    """Expected uncertainty at the parameters of the structure, as Information has it after a fit."""

    names: tuple[str, ...]
    data: Array  # (p, p): Fisher information of the data alone
    deviations: Array  # (p,), one standard deviation, prior included, relative
    undetermined: tuple[str, ...]  # parameters about which the prior says more than the data
    directions: tuple[Direction, ...]  # most open first


def expectation(model: BeamModel, space: ParameterSpace, experiment: Experiment, deviations: Array) -> Expectation:
    """The uncertainty that sensors with white noise of `deviations` (n_all,) leave.

    Raises InputError where the common factor of mass, stiffness and piezo ratios stays open.
    """
    sensors = SensorModel(deviations=deviations, delays=np.zeros(len(deviations)))
    residuals = Residuals(model, [experiment], space, sensors)
    x = np.zeros(residuals.unknowns.size)
    require_scale(model.structure, residuals, x)
    columns = residuals.jacobian(x)[: residuals.data_rows]
    data = np.asarray(columns.T @ columns)
    posterior = np.sqrt(np.diag(np.linalg.inv(data + np.diag(1 / space.deviation**2))))
    return Expectation(
        names=space.names,
        data=data,
        deviations=posterior,
        undetermined=tuple(
            name for name, is_open in zip(space.names, posterior > OPEN * space.deviation, strict=True) if is_open
        ),
        directions=open_directions(data, space.names, OPEN * float(np.median(space.deviation))),
    )
