"""Slow modes that a reduced model lacks."""

import numpy as np
import pytest

from flexbeams.controller.choices import OutputWeight
from flexbeams.controller.design import compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.reduction import reduce
from flexbeams.controller.retained_modes import missing_mode_warnings, missing_modes
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.statespace import spectrum_of
from tests.oracles.chains import chain_of_beams
from tests.oracles.examples import single_beam, three_beams


@pytest.mark.parametrize(("beams", "modes"), [(3, 5), (12, 5), (20, 1)])
@pytest.mark.parametrize("weight", ["identity", "energy"])
def test_chains(beams: int, modes: int, weight: OutputWeight) -> None:
    """With five modes of each beam all are kept; with one, only in the energy norm."""
    model = beam_model(chain_of_beams(beams), "clamped_free", 10)
    system = model.assemble()
    reduced = reduce(model, system, position_states=modes * beams, output_weight=weight)
    spectrum = spectrum_of(system)
    missing = missing_modes(spectrum.oscillating, reduced, beams)
    if modes == 5 or weight == "energy":
        assert missing == []
        return
    assert len(missing) > beams // 2
    frequencies = spectrum.frequencies
    assert all(frequency == pytest.approx(frequencies[k - 1], rel=1e-3) for k, frequency in missing)
    [line] = missing_mode_warnings(spectrum.oscillating, reduced, beams)
    assert f"lacks {len(missing)} of the plant's {beams} slowest modes: 1 at {frequencies[0]:.4g} rad/s, 2 at" in line
    assert f" and {len(missing) - 3} more; " in line


def test_a_design_warns() -> None:
    made = compute_design(single_beam(), DesignOptions(reduced_modes=1, verify="design"))
    assert any("lacks 1 of the plant's 1 slowest modes: 1 at 16.7" in line for line in made.summary["warnings"])
    assert not any("lacks" in line for line in compute_design(three_beams(), DesignOptions()).summary["warnings"])
    assert np.all(np.isfinite(made.arrays["shape_values"]))
