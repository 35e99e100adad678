"""One design, computed once: structure and options -> everything that the units carry."""

from flexbeams.controller.design_record import Design
from flexbeams.controller.options import DesignOptions
from flexbeams.plant.errors import DesignError
from flexbeams.plant.plausibility import implausible_values
from flexbeams.plant.structure import Structure
from flexbeams.plant.threads import one_thread

__all__ = ["Design", "compute_design"]


def compute_design(structure: Structure, options: DesignOptions | None = None) -> Design:
    """Reduction, flatness coefficients, filter and regulator of a structure.

    Arrays: A, B, H_pi, H_pm, H_w, D_pi, D_pm, D_w (reduced, continuous); A_d, B_d (sampled); estimator_gain
    (m, n_pm), feedback_gain (n_u, m), static_inverse (n_u, n_pi) V/m, unreachable (n_pi, n_pi), the part of a target
    that is refused; flat_ratios (m,), mode_series (2 l, m), mode_inputs (2 l, n_u), mode_states (m, 2 l) of
    FlatParameterisation; shape_times, shape_values; transition_table, transition_constants (exponent, norm). With the
    planner "multi_input" in place of these nine those of SplineTransitions.
    Raises DesignError where a step has no acceptable result, or where the closed loop is unstable on a full plant.
    """
    from flexbeams.controller.computation import compute  # which takes longer to load than a kept design

    try:
        with one_thread():
            return compute(structure, options or DesignOptions())
    except DesignError as error:
        if unusual := implausible_values(structure):  # no other advice helps
            raise DesignError(f"there is no design, perhaps because {unusual[0]}") from error
        raise
