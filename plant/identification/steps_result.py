"""The result of the paper's two steps, and how well they determine the parameters.

The steps solve J_D' psi(r) = 0 for the dynamic set D, S_S' s = 0 for the static set S over the rest positions s without
springs, and C_K' c = 0 for the springs K over those with springs. To first order the covariance is G^-1 B G^-T: G has
the derivatives of these equations with respect to all parameters, so that errors of one step carry over to the others,
B the covariances of their left sides. Correlations between a record's transient and its own mean are neglected.
"""

from collections.abc import Callable, Sequence

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BasisName
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.identification.estimate import ROBUST_SCALE, Estimate, Search, Settings
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.information import OPEN, Information, influence, open_directions
from flexbeams.plant.identification.method import Identification, kept_names, parameters_of
from flexbeams.plant.identification.noise import correlation_length
from flexbeams.plant.identification.paper_steps import PaperSteps, Progress
from flexbeams.plant.identification.rest_positions import RestResiduals
from flexbeams.plant.identification.space import ParameterSpace
from flexbeams.plant.identification.start import Start
from flexbeams.plant.statespace import undamped_frequencies
from flexbeams.plant.structure import Structure


def identify_in_steps(
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
    """As `identify`, but by the paper's two steps; undetermined parameters keep their start here as well."""
    settings = settings or Settings()
    model = beam_model(structure, basis, order)
    used = [e for e in experiments if not e.held_back]
    steps = PaperSteps(model, used, space, settings, notify, progress)
    state = Progress(x=np.zeros(len(steps.space.names)))
    robust = ROBUST_SCALE if settings.loss == "soft_l1" else None
    steps.step_one(state)
    steps.step_two(state)
    if not state.interrupted:
        x = steps.original.coordinates(steps.values(state))
        kept = kept_names(_information(steps, state, robust), x)
        if 0 < len(kept) < len(space.names):
            state.kept = frozenset(kept)
            state.x[[name in state.kept for name in steps.space.names]] = 0.0
            steps.step_one(state)
    if not state.interrupted:
        steps.finish(state)
    starts = dict(zip(space.names, space.start.tolist(), strict=True))
    values = {**steps.values(state), **{name: starts[name] for name in state.kept}}
    given = undamped_frequencies(model.assemble(space.values(np.zeros(len(space.names)))))[: len(structure.beam)]
    joint = _information(steps, state, robust)
    return Identification(
        model=model,
        structure=structure.with_parameters(values),
        parameters=parameters_of(structure, space, values, joint, sorted(state.kept)),
        start=Start(
            x=np.zeros(len(space.names)),
            method="the values of the structure file; the paper's two steps",
            modes=None,
            given=given,
        ),
        joint=joint,
        estimate=_whole_estimate(steps, state, used, values, settings),
        held_back=tuple(e for e in experiments if e.held_back),
    )


def _whole_estimate(
    steps: PaperSteps, state: Progress, used: Sequence[Experiment], values: dict[str, float], settings: Settings
) -> Estimate:
    """The residuals of all files at the result."""
    assert state.estimate is not None
    search = Search(steps.model, used, settings)
    search.weights = state.estimate.weights
    space = steps.original.without(set(state.kept), values)
    delays = state.estimate.x[len(state.estimate.residuals.space.names) :]
    x = np.concatenate([space.coordinates(values), delays])
    deviations = search.measured_deviations(search.residuals_of(used, space, search.rough_deviations()), x)
    return Estimate(
        residuals=search.residuals_of(used, space, deviations),
        x=x,
        deviations=deviations,
        weights=search.weights,
        evaluations=state.estimate.evaluations,
        interrupted=state.interrupted,
    )


def _information(steps: PaperSteps, state: Progress, robust_scale: float | None) -> Information:
    """The uncertainty of both steps together, in the coordinates of the original space."""
    assert state.estimate is not None
    original, change = steps.original, steps.rescaling()
    slopes, spread, lengths = _dynamic_equations(steps, state, robust_scale)
    for group, fit, x, to in (
        (steps.statics, RestResiduals(steps.model, steps.loose, steps.space, steps.rest_deviations), state.x, None),
        (
            steps.springs,
            RestResiduals(steps.model, steps.attached, original, steps.rest_deviations),
            original.coordinates(steps.values(state)),
            change,
        ),
    ):
        if not np.any(group):
            continue
        count = len(fit.errors)
        columns = fit.jacobian(x)[:count]
        columns = columns if to is None else columns @ to
        own = columns[:, group]
        slopes[group] += own.T @ columns
        scaled = own * fit.errors[:, None]
        spread[np.ix_(group, group)] += scaled.T @ scaled
    prior = 1 / steps.space.deviation**2
    inverse = np.linalg.inv(slopes + np.diag(prior))
    covariance = change @ inverse @ (spread + np.diag(prior)) @ inverse.T @ change.T
    deviations = np.sqrt(np.diag(covariance))
    data = np.asarray(np.linalg.inv(covariance) - np.diag(1 / original.deviation**2), dtype=np.float64)
    return Information(
        names=original.names,
        deviations=deviations,
        correlations=covariance / np.outer(deviations, deviations),
        covariance=covariance,
        data=data,
        undetermined=tuple(
            name for name, d, p in zip(original.names, deviations, original.deviation, strict=True) if d > OPEN * p
        ),
        directions=open_directions(data, original.names, OPEN * float(np.median(original.deviation))),
        correlation_lengths=lengths,
    )


def _dynamic_equations(steps: PaperSteps, state: Progress, robust_scale: float | None) -> tuple[Array, Array, Array]:
    """Derivatives (p, p) and covariances (p, p) of the dynamic set's equations, zero in the rows of the others, and the
    correlation lengths of the sensors."""
    assert state.estimate is not None
    search, p = steps.search, len(steps.space.names)
    whole = search.residuals_of(search.experiments, steps.space, state.estimate.deviations)
    x = np.concatenate([state.x, state.estimate.x[len(state.estimate.residuals.space.names) :]])
    jacobian, values = whole.jacobian(x).T[:p], whole.residuals(x)
    group = ~(steps.statics | steps.springs)
    slopes, spread = np.zeros((p, p)), np.zeros((p, p))
    lengths = np.ones(search.sensor_count)
    for sensor, spans in whole.sensor_blocks().items():
        psi, slope = influence(np.concatenate([values[span] for span in spans]), robust_scale)
        lengths[sensor] = max(correlation_length(values[span]) for span in spans)
        gram = np.sum([jacobian[:, span] @ jacobian[:, span].T for span in spans], axis=0)
        slopes[group] += float(np.mean(slope)) * gram[group]
        spread[np.ix_(group, group)] += float(np.mean(psi**2)) * lengths[sensor] * gram[np.ix_(group, group)]
    return slopes, spread, lengths
