"""Verification of a design on the plants' modes that count, the limit of its integral gain, and the weight to blame."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cache, partial
from typing import Any

import numpy as np

from flexbeams.controller.closed_loop import SampledPlant, closed_loop_poles, sampled_controller, sampled_plant
from flexbeams.controller.gains import sample_ratio
from flexbeams.controller.options import DesignOptions, Weights
from flexbeams.controller.plant_modes import PlantModes
from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BasisName
from flexbeams.plant.errors import DesignError
from flexbeams.plant.galerkin import DEFAULT_ORDER, BeamModel, beam_model

DESIGN, EXACT = "design", "exact"  # names of the plants
EXACT_BASIS: BasisName = "segment"
PUBLISHED_INTEGRAL_GAIN = 1e-4  # k_I of (45), a sample of 0.2 ms
STABLE = -1e-6  # 1/s: poles of a stable loop are left of it; rounding moves them by less
HIGHEST_INTEGRAL_GAIN, _LOW_INTEGRAL_GAIN = 1.0, 1e-7
_BISECTIONS = 14
SLOW = 500.0  # rad/s: modes of the plants that matter for the integral action
_LEAST_FACTOR = 1e-6  # to which a weight is lowered in search of a stable loop

Recompute = Callable[[DesignOptions], Mapping[str, Array]]


@dataclass(frozen=True, kw_only=True)
class VerifiedLoop:
    """The least stable pole on one plant."""

    plant: str  # DESIGN or EXACT
    pole: complex  # 1/s

    @property
    def stable(self) -> bool:
        """Whether every pole has a negative real part."""
        return self.pole.real < STABLE


@dataclass(frozen=True, kw_only=True)
class Plants:
    """Plants to verify a design on, by name."""

    models: Mapping[str, BeamModel]
    moved: Mapping[str, SampledPlant]  # the modes that the controller moves, others at their statics
    slow: Mapping[str, SampledPlant]  # the slow modes alone
    step: float  # s

    def only(self, name: str) -> "Plants":
        """One of them."""
        return Plants(
            models={name: self.models[name]},
            moved={name: self.moved[name]},
            slow={name: self.slow[name]},
            step=self.step,
        )

    def full(self) -> dict[str, SampledPlant]:
        """The plants with all their modes."""
        return {name: sampled_plant(model, self.step) for name, model in self.models.items()}


def models_of(model: BeamModel) -> dict[str, BeamModel]:
    """The models to verify a design on: its own, and the exact one unless that is its own."""
    models = {DESIGN: model}
    if (model.basis, model.order) != (EXACT_BASIS, DEFAULT_ORDER[EXACT_BASIS]):
        models[EXACT] = beam_model(model.structure, EXACT_BASIS)
    return models


def plants_of(models: Mapping[str, BeamModel], step: float, arrays: Mapping[str, Array]) -> Plants:
    """The plants of models, sampled with `step` s, for the controller of a design's arrays."""
    modes = {name: PlantModes.of(model) for name, model in models.items()}
    controller = sampled_controller(arrays, 0.0)
    return Plants(
        models=models,
        moved={name: m.moved_by(controller, step) for name, m in modes.items()},
        slow={name: m.slow(step, SLOW) for name, m in modes.items()},
        step=step,
    )


def verify_loop(
    arrays: Mapping[str, Array], integral_gain: float, plants: Mapping[str, SampledPlant]
) -> list[VerifiedLoop]:
    """The least stable pole of the sampled loop on each plant."""
    controller = sampled_controller(arrays, integral_gain)
    return [
        VerifiedLoop(plant=name, pole=complex(closed_loop_poles(controller, plant)[0]))
        for name, plant in plants.items()
    ]


def is_stable(arrays: Mapping[str, Array], integral_gain: float, plants: Mapping[str, SampledPlant]) -> bool:
    """Whether the loop is stable on every plant; the first unstable one ends the search."""
    return all(verify_loop(arrays, integral_gain, {name: plant})[0].stable for name, plant in plants.items())


def largest_integral_gain(arrays: Mapping[str, Array], plants: Plants) -> float:
    """The largest k_I of (45), a sample, up to which the loop is stable on every plant, to 1 % and two digits.

    Searched on the slow modes of the plants, since the integral action is slow, and confirmed on all that the
    controller moves. 0 where the loop is not stable for a vanishing gain.
    """
    if not is_stable(arrays, 0.0, plants.slow):
        return 0.0
    gain = two_digits(_slow_limit(arrays, plants.slow))
    if is_stable(arrays, gain, plants.moved):
        return gain
    if not is_stable(arrays, 0.0, plants.moved):
        return 0.0
    return two_digits(_bisect(lambda k: is_stable(arrays, k, plants.moved), 1e-3 * gain, gain, 6))


def _slow_limit(arrays: Mapping[str, Array], plants: Mapping[str, SampledPlant]) -> float:
    """The integral gain at which the loop becomes unstable on one of the plants, at most HIGHEST_INTEGRAL_GAIN."""
    from scipy.optimize import brentq  # takes a while to import

    @cache  # the search begins with both ends again
    def growth(logarithm: float) -> float:
        return max(loop.pole.real for loop in verify_loop(arrays, float(np.exp(logarithm)), plants)) - STABLE

    low, high = np.log(_LOW_INTEGRAL_GAIN), np.log(HIGHEST_INTEGRAL_GAIN)
    if growth(high) < 0:
        return HIGHEST_INTEGRAL_GAIN
    if growth(low) >= 0:
        return _bisect(lambda k: is_stable(arrays, k, plants), 1e-9, _LOW_INTEGRAL_GAIN)
    return float(np.exp(brentq(growth, low, high, xtol=1e-5)))


def _bisect(holds: Callable[[float], bool], good: float, bad: float, steps: int = _BISECTIONS) -> float:
    """A value between `good`, which holds, and `bad`, next to the border, on a logarithmic scale; it holds."""
    for _ in range(steps):
        middle = float(np.sqrt(good * bad))
        good, bad = (middle, bad) if holds(middle) else (good, middle)
    return good


def two_digits(value: float, towards: float = 0.0) -> float:
    """`value` rounded to two significant digits, towards another one."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 1)
    digits = np.floor(value / unit * (1 + 1e-12)) if towards < value else np.ceil(value / unit * (1 - 1e-12))
    return float(f"{digits * unit:.1e}")


@dataclass(frozen=True, kw_only=True)
class Verification:
    """The closed loop of a design on the plants that it was verified on."""

    loops: Sequence[VerifiedLoop]
    integral_gain: float  # k_I of (45) a sample
    integral_gain_limit: float
    exact: bool  # whether the loop has to be stable on the exact plant

    def figures(self) -> dict[str, Any]:
        """For the summary, in JSON's types: poles as [real, imaginary] in 1/s."""
        return {
            "closed_loop": {loop.plant: [loop.pole.real, loop.pole.imag] for loop in self.loops},
            "integral_gain": self.integral_gain,
            "integral_gain_limit": self.integral_gain_limit,
        }

    def warnings(self) -> list[str]:
        """A line where the loop was not required to be stable on the exact plant."""
        if self.exact:
            return []
        pole = next(loop.pole for loop in self.loops if loop.plant == EXACT)
        state = "unstable" if pole.real >= STABLE else "stable"
        return [
            'verify = "design": the loop is verified on the design\'s own plant only; on the exact plant it is '
            f"{state}, pole {_pole_text(pole)} 1/s"
        ]


def verify_design(
    model: BeamModel, arrays: Mapping[str, Array], options: DesignOptions, recompute: Recompute
) -> Verification:
    """Verifies the loop on the design's own plant `model` and on the exact one, of the basis segment.

    `recompute` gives the gains for other options. The integral gain is that of the options; or the published one, but
    at most a third of the largest stable gain; or 0 with the offset-free observer, which leaves nothing to integrate.
    Raises DesignError for a loop that is unstable on a plant that counts, with the weight to blame and the value that
    still holds.
    """
    models = models_of(model)
    plants = plants_of(models, options.sample_time, arrays)
    exact = options.verify == "exact"
    counting = plants if exact else plants.only(DESIGN)
    ratio = sample_ratio(options)
    limit = largest_integral_gain(arrays, counting)
    gain = 0.0 if options.observer == "offset_free" else min(PUBLISHED_INTEGRAL_GAIN * ratio, limit / 3)
    if options.integral_gain is not None:
        gain = options.integral_gain * ratio
        if gain > limit > 0 and not is_stable(arrays, gain, counting.full()):
            raise DesignError(
                f"integral_gain = {options.integral_gain:g} makes the sampled loop unstable; "
                f"{two_digits(limit / ratio):g} still holds"
            )
    loops = verify_loop(arrays, gain, plants.moved)
    if any(not loop.stable and loop.plant in counting.models for loop in loops):
        full = plants.full()
        loops = verify_loop(arrays, gain, full)
        for loop in loops:
            if not loop.stable and loop.plant in counting.models:
                counted = {name: full[name] for name in counting.models}
                raise _instability(loop, options, lambda o: {**arrays, **recompute(o)}, counted)
    return Verification(loops=loops, integral_gain=gain, integral_gain_limit=limit, exact=exact or EXACT not in models)


def _pole_text(pole: complex) -> str:
    return f"{pole.real:.4g}{pole.imag:+.4g}j"


def _instability(
    loop: VerifiedLoop, options: DesignOptions, recompute: Recompute, plants: Mapping[str, SampledPlant]
) -> DesignError:
    """The refusal of an unstable loop: pole, weight to blame and the value that still holds."""
    place = "the design's own plant" if loop.plant == DESIGN else "the exact plant (basis segment)"
    advice = _advice(options, recompute, plants)
    if loop.plant == EXACT:
        advice += '; verify = "design" accepts a loop that is stable on the design\'s own plant only'
    return DesignError(f"the sampled loop is unstable on {place}, pole {_pole_text(loop.pole)} 1/s: {advice}")


def _advice(options: DesignOptions, recompute: Recompute, plants: Mapping[str, SampledPlant]) -> str:
    """The weight to blame, found by bisection with the integral action off."""

    def holds(weights: Weights) -> bool:
        try:
            return is_stable(recompute(replace(options, weights=weights)), 0.0, plants)
        except DesignError:
            return False

    for name, start in _suspects(options.weights):
        value = getattr(options.weights, name)
        change = partial(_with_weight, options.weights, name)
        if not holds(change(start)):
            continue
        good = _bisect(lambda new, change=change: holds(change(new)), start, value)  # type: ignore[misc]
        rounded = two_digits(good, towards=start)
        good = rounded if holds(change(rounded)) else good
        return f"weights.{name} = {value:g} is to blame; {good:.4g} still holds"
    changed = {k: v for k, v in asdict(options.weights).items() if v != getattr(Weights(), k)}
    if changed and holds(Weights()):
        listed = ", ".join(f"weights.{name} = {value:g}" for name, value in changed.items())
        return f"{listed} do not fit together; the default weights hold"
    return "no single weight makes it stable; check the damping of the structure and reduced_modes"


def _with_weight(weights: Weights, name: str, value: float) -> Weights:
    return replace(weights, **{name: value})


def _suspects(weights: Weights) -> list[tuple[str, float]]:
    """Weights that may be to blame, the most changed ones first, each with a value to start the search from."""
    default = Weights()
    positive = [f.name for f in fields(Weights) if getattr(weights, f.name) > 0]
    changed = [name for name in positive if getattr(weights, name) != getattr(default, name)]
    changed.sort(key=lambda name: -abs(np.log(getattr(weights, name) / getattr(default, name))))
    scales = [name for name in ("kalman_q_total", "lqr_q_total") if name not in changed]
    lowered = [(name, getattr(weights, name) * _LEAST_FACTOR) for name in (*changed, *scales)]
    return [*((name, getattr(default, name)) for name in changed), *lowered]
