"""A design as a notebook uses it: plants, reduced model and controller as linear models, loops with margins."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.controller.analysis import Analysis, analyse
from flexbeams.controller.closed_loop import sampled_controller, sampled_plant
from flexbeams.controller.computation import reduced_with
from flexbeams.controller.design import Design
from flexbeams.controller.design_file import write_design
from flexbeams.controller.gains import ControlWeights, control_weights
from flexbeams.controller.loop import Loop
from flexbeams.controller.margins import Margins, loop_margins
from flexbeams.controller.options import DesignOptions
from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BasisName
from flexbeams.plant.energy import energy_form
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.structure import Structure
from flexbeams.scenarios.api.state_space import StateSpace, numbered
from flexbeams.scenarios.runs.run_view import framed


@dataclass(frozen=True, kw_only=True)
class PlantModel(StateSpace):
    """The full model from voltages and forces to deflections and strains; half |x|^2 is the mechanical energy."""

    model: BeamModel
    parameters: Mapping[str, float]  # in place of the structure's


class ClosedLoop(Loop):
    """The loop of a design's controller and a plant: `poles()`, `sensitivity(omega)`, `noise_gain()`, `margins()`."""

    def margins(self) -> Margins:
        """Gain, phase and delay margins of each pair, disk margins of each pair and of all at once.

        Raises DesignError where the loop is unstable.
        """
        return loop_margins(self)


@dataclass(frozen=True, repr=False)
class DesignView:
    """A computed design.

    Examples
    --------
    >>> import flexbeams as fb
    >>> design = fb.design("single_beam")
    >>> design.loop(design.plant(basis="segment")).margins().disk.alpha > 1
    True
    """

    computed: Design

    @property
    def structure(self) -> Structure:
        """The structure that it was computed for."""
        return self.computed.structure

    @property
    def options(self) -> DesignOptions:
        """Its options."""
        return self.computed.options

    @property
    def summary(self) -> dict[str, Any]:
        """Figures, as `flexbeams design --json` prints them, in SI units."""
        return self.computed.summary

    @property
    def arrays(self) -> dict[str, Array]:
        """The numbers that the units compute with, by name."""
        return self.computed.arrays

    @property
    def design_id(self) -> str:
        """Name of the design, equal on every machine; units with equal ids fit each other."""
        return self.computed.design_id

    @property
    def feedback_gain(self) -> Array:
        """K (n_u, m) of u = K (x_ref - x), V."""
        return self.arrays["feedback_gain"]

    @property
    def estimator_gain(self) -> Array:
        """L (m, n_pm) of the Kalman filter in predictor form."""
        return self.arrays["estimator_gain"]

    @cached_property
    def weights(self) -> ControlWeights:
        """The weights (46), (47) of filter and regulator at the sample time, in the states of `model`.

        `Q_c`, `R_c` with `model.sampled(T)` give `feedback_gain`; `Q_o`, `R_o` give `estimator_gain`.
        """
        own = self.computed.model()
        reduced = reduced_with(own, own.assemble(), self.options, self.options.reduced_modes)
        return control_weights(reduced, self.options)

    @property
    def model(self) -> StateSpace:
        """The reduced model, continuous, from voltages to deflections and strains."""
        a = self.arrays
        return StateSpace(
            name="reduced",
            A=a["A"],
            B=a["B"],
            C=np.vstack([a["H_pi"], a["H_pm"]]),
            D=np.vstack([a["D_pi"], a["D_pm"]]),
            inputs=numbered("u", a["B"].shape[1]),
            outputs=(*numbered("y_pi", len(a["H_pi"])), *numbered("y_pm", len(a["H_pm"]))),
        )

    @property
    def controller(self) -> StateSpace:
        """The sampled controller from strains to voltages, with its sample of delay; references are zero."""
        a, K = self.arrays, sampled_controller(self.arrays, self.computed.integral_gain)
        return StateSpace(
            name="controller",
            A=K.A,
            B=K.B,
            C=K.C,
            D=np.zeros((len(K.C), K.B.shape[1])),
            inputs=numbered("y_pm", len(a["H_pm"])),
            outputs=numbered("u", len(K.C)),
            step=self.options.sample_time,
        )

    def plant(
        self, basis: BasisName | None = None, *, order: int | None = None, start: Mapping[str, float] | None = None
    ) -> PlantModel:
        """The full model of the structure, continuous.

        Parameters
        ----------
        basis, order
            `clamped_free` or `segment`, and its modes or degree; by default the design's own.
        start
            Values in place of the structure's, such as `{"beam[1].tip_mass": 0.03, "spring[].stiffness": 5.5}`.

        Raises
        ------
        InputError
            For an unknown basis or parameter.
        """
        model = self.computed.model(basis, order)
        parameters = _parameters(self.structure, start or {})
        system = model.assemble(parameters)
        n_u, rows = system.L.shape[1], np.vstack([model.deflection, model.strain])
        form = energy_form(system.M, system.D, system.K, np.hstack([system.L, model.tips.T]))
        return PlantModel(
            name="plant",
            A=form.A,
            B=form.B,
            C=form.outputs(rows),
            D=np.zeros((len(rows), form.B.shape[1])),
            inputs=(*numbered("u", n_u), *numbered("force", len(model.tips))),
            outputs=(*numbered("y_pi", len(model.deflection)), *numbered("y_pm", len(model.strain))),
            model=model,
            parameters=parameters,
        )

    def loop(self, plant: PlantModel | None = None) -> ClosedLoop:
        """The loop that the controller closes on a plant, by default that of the design's own basis."""
        closed = self.plant() if plant is None else plant
        return ClosedLoop(
            sampled_controller(self.arrays, self.computed.integral_gain),
            sampled_plant(closed.model, self.options.sample_time, dict(closed.parameters)),
        )

    def analysis(self) -> Analysis:
        """All that `flexbeams design` shows beside the summary."""
        return analyse(self.computed)

    def __repr__(self) -> str:
        figures = self.summary
        states = f"{figures['full_order']} states, reduced to {figures['reduced_order']}"
        beams = "1 beam" if figures["beams"] == 1 else f"{figures['beams']} beams"
        return f"design {self.design_id}: {beams}, {states}"

    def _repr_html_(self) -> str:
        """The page of `flexbeams design --report` in a frame of its own; it needs nothing from outside."""
        from flexbeams.scenarios.report.design import design_html

        return framed(design_html(self.analysis(), self.design_id[:12]), "design")

    def save(self, file: str | Path) -> Path:
        """Writes the design file; InputError where that is not possible."""
        write_design(self.computed, Path(file))
        return Path(file)


def _parameters(structure: Structure, start: Mapping[str, float]) -> dict[str, float]:
    """Values by full name; a key with [] stands for all of its kind."""
    known = structure.parameters()
    families = {name: re.sub(r"\[\d+\]", "[]", name) for name in known}
    parameters: dict[str, float] = {}
    for key, value in start.items():
        names = [name for name in known if key in (name, families[name])]
        if not names:
            raise InputError(
                f"start.{key}", "is not a parameter" + suggestion(key, [*dict.fromkeys(families.values()), *known])
            )
        if not np.isfinite(value) or value < 0:
            raise InputError(f"start.{key}", "must be finite and >= 0", value)
        parameters |= dict.fromkeys(names, float(value))
    return parameters
