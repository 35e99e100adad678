"""What an engineer reads about a design: the closed loop on both plants, its statics, pairs and gauges, Bode curves.

Computed on request; the design itself carries none of it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flexbeams.controller.closed_loop import SampledPlant, sampled_controller, sampled_plant
from flexbeams.controller.design import Design
from flexbeams.controller.frequency import Complex, SchurForm
from flexbeams.controller.loop import LOWEST_FREQUENCY, Loop
from flexbeams.controller.margins import Margins, loop_margins
from flexbeams.controller.ranking import Ranking, rank
from flexbeams.controller.static_error import StaticErrors, static_errors
from flexbeams.controller.verification import models_of
from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.statespace import frequency_responses, static_gains
from flexbeams.plant.threads import one_thread

CURVE_POINTS = 240
HIGHEST_SHOWN = 1.5  # Bode curves end at so many times the fastest retained mode


@dataclass(frozen=True, kw_only=True)
class LoopAnalysis:
    """The loop on one plant."""

    poles: Complex  # (n,), 1/s, the least stable first
    margins: Margins | None  # None where the loop is unstable
    noise_gain: Array | None  # (n_u,), V rms for white strain noise of 1 m/m rms a sample
    omega: Array  # (k,), rad/s
    S: Array  # (k, n_u), singular values, descending
    T: Array  # (k, n_u)
    KS: Array  # (k, min(n_u, n_pm)), V
    static_strain: Array  # (n_pm, n_u), 1/V

    def figures(self) -> dict[str, Any]:
        """For the summary, in JSON's types."""
        return {
            "poles": _pairs(self.poles),
            "margins": self.margins.figures() if self.margins else None,
            "noise_gain": None if self.noise_gain is None else self.noise_gain.tolist(),
            "frequency": self.omega.tolist(),
            "sensitivity": self.S.tolist(),
            "complementary_sensitivity": self.T.tolist(),
            "control_sensitivity": self.KS.tolist(),
            "static_gain_pm": self.static_strain.tolist(),
        }


@dataclass(frozen=True, kw_only=True)
class Bode:
    """Frequency responses of the plants and of the reduced model from voltages to y_pi and y_pm."""

    omega: Array  # (k,), rad/s
    deflection: Mapping[str, Complex]  # by model, (k, n_pi, n_u), m/V
    strain: Mapping[str, Complex]  # by model, (k, n_pm, n_u), 1/V

    def figures(self) -> dict[str, Any]:
        """For the summary, in JSON's types: magnitude and phase (rad) by model, output and pair."""
        return {
            "frequency": self.omega.tolist(),
            **{
                name: {
                    "deflection_magnitude": np.abs(self.deflection[name]).tolist(),
                    "deflection_phase": np.angle(self.deflection[name]).tolist(),
                    "strain_magnitude": np.abs(self.strain[name]).tolist(),
                    "strain_phase": np.angle(self.strain[name]).tolist(),
                }
                for name in self.deflection
            },
        }


UNITS = {
    "frequencies": "rad/s",
    "damping_ratios": "1",
    "damped_eigenvalues": "1/s",
    "real_eigenvalues": "1/s",
    "hankel_position": "1",
    "hankel_velocity": "1",
    "hankel_share": "1",
    "reduced_eigenvalues": "1/s",
    "estimator_eigenvalues": "1/s",
    "feedback_eigenvalues": "1/s",
    "closed_loop": "1/s",
    "static_gain_pi": "m/V",
    "static_gain_pm": "1/V",
    "static_gain_reduced_pi": "m/V",
    "static_gain_reduced_pm": "1/V",
    "static_error": "m",
    "poles": "1/s",
    "frequency": "rad/s",
    "disk_frequency": "rad/s",
    "alpha": "1",
    "disk": "1",
    "gain_reduction": "1",
    "gain_increase": "1",
    "phase": "deg",
    "delay": "s",
    "noise_gain": "V rms for strain noise of 1 m/m rms a sample",
    "sensitivity": "1",
    "complementary_sensitivity": "1",
    "control_sensitivity": "V",
    "deflection_magnitude": "m/V",
    "strain_magnitude": "1/V",
    "deflection_phase": "rad",
    "strain_phase": "rad",
    "hankel_loss_without_pair": "1",
    "hankel_loss_without_gauge": "1",
}


@dataclass(frozen=True, kw_only=True)
class Analysis:
    """Everything beside the summary of a design."""

    design: Design
    loops: Mapping[str, LoopAnalysis]  # by plant: "design", "exact"
    static_errors: StaticErrors
    ranking: Ranking
    bode: Bode
    units: Mapping[str, str] = field(default_factory=lambda: dict(UNITS))

    def figures(self) -> dict[str, Any]:
        """For --json: beside the summary, in JSON's types, and the units of both."""
        return {
            "loops": {name: loop.figures() for name, loop in self.loops.items()},
            "static_error": self.static_errors.figures(),
            "ranking": self.ranking.figures(),
            "bode": self.bode.figures(),
            "units": dict(self.units),
        }


def analyse(design: Design, targets: Array | None = None) -> Analysis:
    """The analysis of a design; `targets` (k, n_pi), m, for the static errors."""
    with one_thread():
        models = models_of(design.model())
        return Analysis(
            design=design,
            loops={name: _loop(design, model) for name, model in models.items()},
            static_errors=static_errors(design, targets=targets),
            ranking=rank(design),
            bode=bode_of(design, models),
        )


def loop_of(design: Design, plant: SampledPlant) -> Loop:
    """The loop of a design's controller on a plant."""
    return Loop(sampled_controller(design.arrays, design.integral_gain), plant)


def _loop(design: Design, model: BeamModel) -> LoopAnalysis:
    loop = loop_of(design, sampled_plant(model, design.options.sample_time))
    poles = loop.poles()
    stable = bool(poles[0].real < 0)
    omega = np.geomspace(LOWEST_FREQUENCY, np.pi / loop.plant.step, CURVE_POINTS)
    response = loop.sensitivity(omega)
    return LoopAnalysis(
        poles=poles,
        margins=loop_margins(loop) if stable else None,
        noise_gain=loop.noise_gain() if stable else None,
        omega=omega,
        **{name: np.linalg.svd(getattr(response, name), compute_uv=False) for name in ("S", "T", "KS")},
        static_strain=static_gains(model, model.assemble())[1],
    )


def bode_of(design: Design, models: Mapping[str, BeamModel]) -> Bode:
    """Continuous responses of full models and of the reduced one, from below the slowest mode to above the fastest."""
    arrays = design.arrays
    magnitudes = np.abs(np.linalg.eigvals(arrays["A"]))
    omega = np.geomspace(0.3 * magnitudes.min(), HIGHEST_SHOWN * magnitudes.max(), CURVE_POINTS)
    points = len(arrays["H_pi"])
    responses = {}
    for name, model in models.items():
        responses[name] = frequency_responses(model.assemble(), np.vstack([model.deflection, model.strain]), omega)
    through = np.vstack([arrays["D_pi"], arrays["D_pm"]])
    outputs = np.vstack([arrays["H_pi"], arrays["H_pm"]])
    responses["reduced"] = SchurForm.of(arrays["A"], arrays["B"], outputs).at(1j * omega) + through
    return Bode(
        omega=omega,
        deflection={name: r[:, :points] for name, r in responses.items()},
        strain={name: r[:, points:] for name, r in responses.items()},
    )


def _pairs(values: Complex) -> list[list[float]]:
    return [[float(v.real), float(v.imag)] for v in values]
