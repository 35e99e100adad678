"""The two steps of section 4.1 of the paper: uncoupled beams first, then the springs.

1. Springs taken off: densities, tip masses and dampings (the dynamic set) from the transients, moduli and piezo ratios
   (the static set) from the rest positions, in turn until both settle.
2. Springs attached: their stiffnesses from the rest positions.

Rest positions do not show a common factor of a beam's moduli and piezo ratios: it stays that of the start. Where a mass
of the beam is known instead of one of these, it is left free in step 1, and in the end all parameters of the beam are
multiplied by the factor that makes the mass what it is; responses to voltages stay the same.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.identification.estimate import CAUTIOUS_WEIGHT, Estimate, Search, Settings
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.rest_positions import RestPosition, RestResiduals, rest_positions
from flexbeams.plant.identification.scale import members
from flexbeams.plant.identification.space import ParameterSpace
from flexbeams.plant.structure import Structure

STATIC_SET = ("youngs_modulus", "piezo_ratio")
PASSES = 12  # at most, of the dynamic and the static set
SETTLED = 3e-4  # largest relative change of a parameter after which a pass is the last
REST_ERROR = 2e-3  # of a sensor's rms over the rest positions: weighs these against the priors


@dataclass(kw_only=True)
class Progress:
    """Where the steps are."""

    x: Array  # (p,), in the space of the steps
    kept: frozenset[str] = frozenset()  # undetermined parameters, at their start
    estimate: Estimate | None = None  # of the dynamic set

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended step 1."""
        return self.estimate is not None and self.estimate.interrupted


class PaperSteps:
    """Both steps for voltage steps from rest, with the springs taken off and attached.

    Raises InputError where the experiments or the known parameters do not suit them.
    """

    def __init__(
        self,
        model: BeamModel,
        experiments: Sequence[Experiment],
        space: ParameterSpace,
        settings: Settings,
        notify: Callable[[str], None],
        progress: Callable[[int, int], None],
    ) -> None:
        loose = [e for e in experiments if e.uncoupled]
        attached = [e for e in experiments if not e.uncoupled]
        _require_experiments(loose, attached, space, settings)
        self.model, self.original, self.notify = model, space, notify
        self.scales = known_masses(model.structure, space)
        self.space = space.free_as_well(list(self.scales))
        self.search = Search(model, loose, settings, notify, progress)
        weights = settings.weights
        if weights is None:
            weights = np.where(np.arange(self.search.sensor_count) < len(model.deflection), 1.0, CAUTIOUS_WEIGHT)
        self.loose, self.attached = rest_positions(loose), rest_positions(attached)
        for positions, files in ((self.loose, "--uncoupled files"), (self.attached, "other files")):
            if not positions and (files == "--uncoupled files" or np.any(self.springs)):
                raise InputError("--steps", f"paper needs voltages that stay constant for seconds in the {files}")
        self.rest_deviations = REST_ERROR * _sizes([*self.loose, *self.attached], self.search.sensor_count) / weights

    @property
    def springs(self) -> NDArray[np.bool_]:
        """Which parameters (p,) of the steps' space step 2 fits."""
        return np.array([name.startswith("spring[") for name in self.space.names])

    @property
    def statics(self) -> NDArray[np.bool_]:
        """Which parameters (p,) are of the static set."""
        return np.array([name.endswith(STATIC_SET) for name in self.space.names])

    def step_one(self, state: Progress) -> None:
        """Dynamic and static set in turn."""
        for number in range(1, PASSES + 1):
            before = state.x.copy()
            self.notify(f"dynamic set, pass {number}")
            self._fit_dynamic(state)
            if state.interrupted:
                return
            self._fit_static(state)
            if np.max(np.abs(state.x - before)) < SETTLED:
                return

    def step_two(self, state: Progress) -> None:
        """The springs."""
        if np.any(self.springs):
            chosen = self._chosen(state, self.springs)
            names = np.array(self.space.names)[chosen]
            part = self.original.without(set(self.original.names) - set(names), self.values(state))
            fit = RestResiduals(self.model, self.attached, part, self.rest_deviations)
            state.x[chosen] = fit.fitted(state.x[chosen])

    def finish(self, state: Progress) -> None:
        """The dynamic set over all rows, once both sets have settled."""
        assert state.estimate is not None
        chosen, part = self._dynamic(state)
        x = np.concatenate([state.x[chosen], state.estimate.x[len(part.names) :]])
        state.estimate = self.search.fine(part, x, state.estimate.deviations)
        state.x[chosen] = state.estimate.x[: len(part.names)]
        self.step_two(state)

    def values(self, state: Progress) -> dict[str, float]:
        """All parameters, SI, with the known masses as they are."""
        values = self.space.values(state.x)
        for name, own in self.scales.items():
            factor = self.original.fixed[name] / values[name]
            values |= {other: factor * values[other] for other in own}
        return values

    def rescaling(self) -> Array:
        """Derivative (q, p) of the coordinates of the original space with respect to those of the steps' space."""
        names, derivative = self.space.names, np.eye(len(self.original.names), len(self.space.names))
        for name, own in self.scales.items():
            for k, other in enumerate(self.original.names):
                if other in own and self.original.logarithmic[k]:
                    derivative[k, names.index(name)] -= 1.0
        return derivative

    def _fit_dynamic(self, state: Progress) -> None:
        chosen, part = self._dynamic(state)
        if state.estimate is None:
            state.estimate = self.search.coarse(part, state.x[chosen])
        else:
            others = state.estimate.x[len(state.estimate.residuals.space.names) :]
            x = np.concatenate([state.x[chosen], others])
            state.estimate = self.search.refined(part, x, state.estimate.deviations)
        state.x[chosen] = state.estimate.x[: len(part.names)]

    def _fit_static(self, state: Progress) -> None:
        chosen = self._chosen(state, self.statics)
        if np.any(chosen):
            part = self._part(state, chosen)
            state.x[chosen] = RestResiduals(self.model, self.loose, part, self.rest_deviations).fitted(state.x[chosen])

    def _dynamic(self, state: Progress) -> tuple[NDArray[np.bool_], ParameterSpace]:
        chosen = self._chosen(state, ~(self.statics | self.springs))
        return chosen, self._part(state, chosen)

    def _chosen(self, state: Progress, group: NDArray[np.bool_]) -> NDArray[np.bool_]:
        return np.asarray(group & [name not in state.kept for name in self.space.names], dtype=np.bool_)

    def _part(self, state: Progress, chosen: NDArray[np.bool_]) -> ParameterSpace:
        """The space of the chosen parameters, the others at their present value."""
        others = {name for name, own in zip(self.space.names, chosen, strict=True) if not own}
        return self.space.without(others, self.space.values(state.x))


def known_masses(structure: Structure, space: ParameterSpace) -> dict[str, list[str]]:
    """For each beam without a known modulus or piezo ratio, its known mass or damping, and all its parameters."""
    found = {}
    for j in range(1, len(structure.beam) + 1):
        own = [name for name in members(structure, [j]) if not name.startswith("spring[")]
        known = [name for name in own if space.fixed.get(name, 0.0) > 0]
        if any(name.endswith(STATIC_SET) for name in known) or not any(name in space.names for name in own):
            continue
        if len(known) != 1:
            has = "none" if not known else ", ".join(known)
            raise InputError(
                "--steps",
                f"paper needs one known part of each beam, or a known modulus or piezo ratio; of beam {j} it has {has}"
                f": give, for example, --known beam[{j}].tip_mass={structure.beam[j - 1].tip_mass:g} alone",
            )
        found[known[0]] = own
    return found


def _require_experiments(
    loose: Sequence[Experiment], attached: Sequence[Experiment], space: ParameterSpace, settings: Settings
) -> None:
    if not loose:
        raise InputError("--steps", "paper needs files recorded with the springs taken off: give --uncoupled")
    if not attached and any(name.startswith("spring[") for name in space.names):
        raise InputError("--steps", "paper needs files recorded with the springs attached, for step 2")
    if settings.fit_offsets:
        raise InputError("--fit-offsets", "is not possible with --steps paper")
    for experiment in (*loose, *attached):
        if experiment.start != "rest" or (experiment.forces is not None and np.any(experiment.forces)):
            raise InputError("", "must start at rest and have no forces, for --steps paper", source=experiment.name)


def _sizes(positions: Sequence[RestPosition], sensors: int) -> Array:
    """rms (n_all,) of each sensor over the rest positions."""
    squares, counts = np.zeros(sensors), np.zeros(sensors)
    for position in positions:
        squares[list(position.sensors)] += position.means**2
        counts[list(position.sensors)] += 1
    return np.asarray(np.sqrt(np.where(squares > 0, squares, 1.0) / np.maximum(counts, 1)))
