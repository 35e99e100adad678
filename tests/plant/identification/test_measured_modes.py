"""Modes measured without a model of the structure, and starts fitted to them."""

import numpy as np
import pytest

from flexbeams.plant.identification.measured_modes import measured_modes
from flexbeams.plant.identification.modal import modal_form
from flexbeams.plant.identification.space import parameter_space
from flexbeams.plant.identification.start import starting_point
from flexbeams.plant.statespace import static_gains, undamped_frequencies
from tests.plant.identification.data import PATTERNS, kiel, measured, space_of, steps

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("noise", "tolerance"), [(0.0, 2e-3), (0.005, 5e-3)])
def test_the_first_modes_of_three_beams(noise: float, tolerance: float) -> None:
    structure, model = kiel()
    data = measured(model, structure.parameters(), steps(PATTERNS, 10, rows=1000), noise, 1)
    modes = measured_modes(data, 60.0)
    first = [int(np.argmin(np.abs(modes.frequencies - f))) for f in undamped_frequencies(model.assemble())[:3]]
    poles = modal_form(model, structure.parameters()).poles[:3]
    assert np.allclose(modes.frequencies[first], np.abs(poles), rtol=tolerance)
    assert np.allclose(modes.damping_ratios[first], -poles.real / np.abs(poles), rtol=0.4)
    assert np.all(modes.shares[first] > 0.05)
    gains = np.vstack(static_gains(model, model.assemble()))
    assert np.max(np.abs(modes.static_gains - gains) / np.max(np.abs(gains), axis=1)[:, None]) < 0.12


def test_short_data_are_refused() -> None:
    structure, model = kiel()
    with pytest.raises(ValueError, match="too short"):
        measured_modes(measured(model, structure.parameters(), steps(PATTERNS[:1], 10, rows=60), 0.0, 1), 60.0)


def test_a_start_fitted_to_modes_has_their_frequencies_and_gains() -> None:
    structure, model = kiel()
    data = measured(model, structure.parameters(), steps(PATTERNS, 10, rows=1000), 0.0, 1)
    truth = structure.parameters()
    start = structure.with_parameters(
        {f"beam[{k}].youngs_modulus": 2.5 * truth[f"beam[{k}].youngs_modulus"] for k in (1, 2, 3)}
    )
    space = space_of(start)
    found = starting_point(model, data, space)
    assert found.replaced
    values = space.values(found.x)
    wanted = undamped_frequencies(model.assemble())[:3]
    assert np.allclose(undamped_frequencies(model.assemble(values))[:3], wanted, rtol=0.01)
    gains, own = static_gains(model, model.assemble())[0], static_gains(model, model.assemble(values))[0]
    assert np.max(np.abs(own - gains)) < 0.1 * np.max(np.abs(gains))


def test_the_start_says_how_it_was_found() -> None:
    structure, model = kiel()
    data = measured(model, structure.parameters(), steps(PATTERNS, 10, rows=1000), 0.005, 1)
    near = starting_point(model, data, parameter_space(structure))
    assert near.method.startswith("the values of the structure file; its first frequencies are within ")
    assert np.all(near.x == 0)
    short = starting_point(model, [e.first(50) for e in data], parameter_space(structure))
    assert short.method.endswith("the data are too short to measure frequencies")
