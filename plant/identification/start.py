"""A start for the search where the structure's own values are far off: frequencies and static gains of the data.

Both are smooth in the logarithms of the parameters, without the local minima of oscillations that drift apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import least_squares

from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.measured_modes import MeasuredModes, measured_modes
from flexbeams.plant.identification.sensitivity import modal_system
from flexbeams.plant.identification.space import ParameterSpace
from flexbeams.plant.statespace import undamped_frequencies

FAR = 0.2  # relative difference of a frequency beyond which the start is replaced
LEAST_SHARE = 0.01  # of the response's energy that a measured mode must hold
_FREQUENCY, _GAIN, _PRIOR = 0.01, 0.05, 1.0  # deviations: of ln frequency, of a gain over its sensor's, of the start


@dataclass(frozen=True, kw_only=True)
class Start:
    """Where the search begins."""

    x: Array  # (p,)
    method: str  # one sentence for people
    modes: MeasuredModes | None  # the first modes that the data show
    given: Array  # (k,), frequencies of the structure's own values, rad/s
    replaced: bool = False  # fitted to measured modes


def starting_point(model: BeamModel, experiments: Sequence[Experiment], space: ParameterSpace) -> Start:
    """The structure's own values, or, where a measured frequency differs by more than FAR, fitted ones.

    Compared are the first r frequencies of r beams, which lie close together and carry the slow motion.
    """
    origin = np.zeros(len(space.names))
    given = undamped_frequencies(model.assemble(space.values(origin)))[: len(model.structure.beam)]
    coupled = [e for e in experiments if not e.uncoupled and e.start == "rest"]

    def own(reason: str, modes: MeasuredModes | None = None) -> Start:
        return Start(x=origin, method=f"the values of the structure file; {reason}", modes=modes, given=given)

    if not coupled:
        return own("no experiment from rest with springs attached shows frequencies to compare with")
    try:
        modes = _lowest(measured_modes(coupled, _highest(coupled)), len(model.structure.beam))
    except ValueError:
        return own("the data are too short to measure frequencies")
    if len(modes.frequencies) < len(given):
        return own(f"only {len(modes.frequencies)} modes stand out in the data")
    farthest = 100 * float(np.max(np.abs(given / modes.frequencies - 1)))
    if farthest <= 100 * FAR:
        return own(f"its first frequencies are within {farthest:.0f} % of the measured ones", modes)
    return fitted_start(model, modes, space, f"a frequency of the structure file is {farthest:.0f} % off")


def fitted_start(model: BeamModel, modes: MeasuredModes, space: ParameterSpace, reason: str) -> Start:
    """A start fitted to measured modes, for a reason."""
    given = undamped_frequencies(model.assemble(space.values(np.zeros(len(space.names)))))[: len(modes.frequencies)]
    return Start(
        x=fit_modes(model, modes, space),
        method=f"fitted to measured frequencies and static gains, because {reason}",
        modes=modes,
        given=given,
        replaced=True,
    )


def fit_modes(model: BeamModel, modes: MeasuredModes, space: ParameterSpace) -> Array:
    """Unknowns x (p,) whose first frequencies and static gains are those of the data."""
    rows = np.vstack([model.deflection, model.strain])[list(modes.sensors)]
    sizes = np.sqrt(np.mean(modes.static_gains**2, axis=1, keepdims=True))
    excited = np.linalg.norm(modes.static_gains, axis=0) > 1e-6 * np.linalg.norm(modes.static_gains)
    terms = {term.parameter: term for term in model.terms}
    count = len(modes.frequencies)

    def residuals(x: Array) -> Array:
        system = model.assemble(space.values(x))
        frequencies = undamped_frequencies(system)[:count]
        gains = rows @ cho_solve(cho_factor(system.K, lower=True), system.L)
        return np.concatenate(
            [
                np.log(frequencies / modes.frequencies) / _FREQUENCY,
                ((gains - modes.static_gains) / sizes / _GAIN)[:, excited].ravel(),
                x / _PRIOR,
            ]
        )

    def jacobian(x: Array) -> Array:
        values = space.values(x)
        form, derivatives = modal_system(model, values, list(space.names))
        system = model.assemble(values)
        factor = cho_factor(system.K, lower=True)
        rest, seen = cho_solve(factor, system.L), cho_solve(factor, rows.T).T
        columns = []
        for name, derivative, slope in zip(space.names, derivatives, space.slopes(x), strict=True):
            # d ln|lambda| = Re(d lambda / lambda)
            shift = (derivative.shift[:count] / form.poles[:count]).real
            term = terms[name]
            part = slice(term.start, term.start + len(term.block))
            gains = np.zeros_like(modes.static_gains)
            if term.matrix == "K":
                gains = -(seen[:, part] @ term.block) @ rest[part]
            elif term.matrix == "L":
                gains[:, term.column] = seen[:, part] @ term.block[:, 0]
            columns.append(slope * np.concatenate([shift / _FREQUENCY, (gains / sizes / _GAIN)[:, excited].ravel()]))
        return np.vstack([np.stack(columns, axis=1), np.eye(len(x)) / _PRIOR])

    result = least_squares(
        residuals, np.zeros(len(space.names)), jac=jacobian, bounds=(space.lower, space.upper), max_nfev=60
    )
    x: Array = result.x
    return x


def _lowest(modes: MeasuredModes, count: int) -> MeasuredModes:
    """The first modes that hold a share worth the name."""
    chosen = np.flatnonzero(modes.shares > LEAST_SHARE)[:count]
    return MeasuredModes(
        frequencies=modes.frequencies[chosen],
        damping_ratios=modes.damping_ratios[chosen],
        shares=modes.shares[chosen],
        static_gains=modes.static_gains,
        sensors=modes.sensors,
    )


def _highest(experiments: Sequence[Experiment]) -> float:
    """Twice the frequency below which 95 % of the sensors' oscillation above the noise floor lies, rad/s."""
    power: Array = np.zeros(1)
    grid: Array = np.zeros(1)
    longest = max(e.rows for e in experiments)
    for experiment in experiments:
        y = experiment.outputs[experiment.onset :]
        y = y - np.mean(y, axis=0)
        size = np.sqrt(np.mean(y**2, axis=0))
        y = y / np.where(size > 0, size, 1.0) * np.hanning(len(y))[:, None]
        power = power + np.sum(np.abs(np.fft.rfft(y, longest, axis=0)) ** 2, axis=1)
        grid = 2 * np.pi / (longest * experiment.step) * np.arange(longest // 2 + 1, dtype=np.float64)
    above = np.maximum(power - 3 * np.median(power), 0)
    share = np.cumsum(above) / max(float(np.sum(above)), 1e-300)
    return 2 * float(grid[min(int(np.searchsorted(share, 0.95)), len(grid) - 1)])
