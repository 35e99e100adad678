"""From experiments and a start to the parameters that the data determine, and to what they leave open."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BasisName
from flexbeams.plant.galerkin import BeamModel, beam_model
from flexbeams.plant.identification.estimate import ROBUST_SCALE, Estimate, Search, Settings
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.information import Information, information
from flexbeams.plant.identification.scale import require_scale
from flexbeams.plant.identification.space import ParameterSpace
from flexbeams.plant.identification.start import Start, fitted_start, starting_point
from flexbeams.plant.structure import Structure

MISFIT = 0.03  # rms of the deflections' residuals over that of the deflections, beyond which another start is tried
CONTRADICTION = 3.0  # deviations of the data by which a start may miss before it is no longer kept


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """What an identification says of one parameter."""

    name: str
    start: float  # SI
    value: float  # SI
    deviation: float  # relative, one standard deviation; 0 for a known one
    status: str  # fitted, assumed (undetermined by data) or known


@dataclass(frozen=True, kw_only=True)
class Identification:
    """The result: parameters, their uncertainty, and the fit itself."""

    model: BeamModel  # of the structure at the start
    structure: Structure  # with the identified parameters
    parameters: tuple[Parameter, ...]
    start: Start
    joint: Information  # of all free parameters together
    estimate: Estimate  # of the fitted ones, the undetermined ones at their start
    held_back: tuple[Experiment, ...] = field(default=())

    @property
    def fitted(self) -> tuple[Parameter, ...]:
        """The parameters that the data determine."""
        return tuple(p for p in self.parameters if p.status == "fitted")


def identify(
    structure: Structure,
    experiments: Sequence[Experiment],
    space: ParameterSpace,
    *,
    basis: BasisName = "clamped_free",
    order: int | None = None,
    settings: Settings | None = None,
    notify: Callable[[str], None] = lambda text: None,
    progress: Callable[[int, int], None] = lambda done, most: None,
) -> Identification:
    """The parameters of `space` from the experiments that are not held back.

    All free parameters are estimated together, with the priors of the space. Those about which the data say less than
    the prior are then set back to their start and the others estimated once more, so that the result predicts what
    the fit predicted. Raises InputError where the common factor of mass, stiffness and piezo ratios stays open.
    """
    settings = settings or Settings()
    model = beam_model(structure, basis, order)
    used = [e for e in experiments if not e.held_back]
    search = Search(model, used, settings, notify, progress)
    rough = search.residuals_of(used, space, search.rough_deviations(), rough=True)
    require_scale(structure, rough, rough.with_loads(np.zeros(rough.unknowns.size)))
    start, estimate = _coarse(search, space)
    robust = ROBUST_SCALE if settings.loss == "soft_l1" else None
    kept: list[str] = []
    fitted, x = space, estimate.x
    if not estimate.interrupted:
        # The thinned rows say less; with all of them the deviations shrink by the root of the thinning
        kept = kept_names(information(estimate.residuals, x, robust_scale=robust, rows=estimate.residuals.stride), x)
        if 0 < len(kept) < len(space.names):
            fixed = np.zeros(len(x), dtype=bool)
            fixed[: len(space.names)] = [name in kept for name in space.names]
            fitted, x = space.without(set(kept), space.values(np.zeros(len(space.names)))), x[~fixed]
        estimate = search.fine(fitted, x, estimate.deviations)
    whole = search.residuals_of(used, space, estimate.deviations)
    others = estimate.x[len(fitted.names) :]
    x = np.concatenate([space.coordinates(estimate.values), others])
    joint = information(whole, x, robust_scale=robust)
    return Identification(
        model=model,
        structure=structure.with_parameters(estimate.values),
        parameters=parameters_of(structure, space, estimate.values, joint, kept),
        start=start,
        joint=joint,
        estimate=estimate,
        held_back=tuple(e for e in experiments if e.held_back),
    )


def _coarse(search: Search, space: ParameterSpace) -> tuple[Start, Estimate]:
    """The thinned rows' estimate; where it stays far from the data, the better one of two starts."""
    start = starting_point(search.model, search.experiments, space)
    estimate = search.coarse(space, start.x)
    if estimate.interrupted or search.misfit(estimate) < MISFIT or start.modes is None or start.replaced:
        return start, estimate
    other = fitted_start(search.model, start.modes, space, "the fit from the structure file's values stayed far off")
    second = search.coarse(space, other.x)
    return (other, second) if search.misfit(second) < search.misfit(estimate) else (start, estimate)


def kept_names(joint: Information, x: Array) -> list[str]:
    """Undetermined parameters whose start the data do not contradict."""
    undetermined = set(joint.undetermined)
    return [
        name
        for name, value, deviation in zip(joint.names, x, joint.deviations, strict=False)
        if name in undetermined and abs(value) <= CONTRADICTION * deviation
    ]


def parameters_of(
    structure: Structure, space: ParameterSpace, values: Mapping[str, float], joint: Information, kept: Sequence[str]
) -> tuple[Parameter, ...]:
    """What an identification with `values` says of all parameters; those in `kept` stayed at their start."""
    relative = dict(zip(joint.names, joint.deviations, strict=True))
    for k, name in enumerate(space.names):
        if not space.logarithmic[k]:
            relative[name] *= space.scale[k] / max(values[name], 1e-300)
    starts = {**structure.parameters(), **space.fixed, **dict(zip(space.names, space.start, strict=True))}
    return tuple(
        Parameter(
            name=name,
            start=float(starts[name]),
            value=float(value),
            deviation=float(relative.get(name, 0.0)),
            status="known" if name in space.fixed else "assumed" if name in kept else "fitted",
        )
        for name, value in ((name, values[name]) for name in structure.parameters())
    )
