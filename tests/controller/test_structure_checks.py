"""Parts of a structure that a controller cannot use are named; designs of unusual structures."""

from dataclasses import replace

import numpy as np
import pytest

from flexbeams.controller.design import compute_design
from flexbeams.controller.options import DesignOptions, Weights
from flexbeams.controller.structure_checks import structure_warnings
from flexbeams.plant.galerkin import BasisName, beam_model
from flexbeams.plant.statespace import undamped_frequencies
from flexbeams.plant.structure import Spring, StrainGauge, Structure, find_structure, read_structure
from tests.oracles.examples import beam, gauge, patch, point, single_beam

KIEL = read_structure(find_structure("kiel"))


def warnings_of(structure: Structure, basis: BasisName = "clamped_free") -> list[str]:
    model = beam_model(structure, basis)
    return structure_warnings(model, model.assemble())


@pytest.mark.parametrize("basis", ["clamped_free", "segment"])
@pytest.mark.parametrize("name", ["kiel", "five_beams", "single_beam"])
def test_shipped_structures_have_no_warning(name: str, basis: BasisName) -> None:
    assert warnings_of(read_structure(find_structure(name)), basis) == []


@pytest.mark.parametrize("basis", ["clamped_free", "segment"])
def test_gauges_near_the_tip_are_blind(basis: BasisName) -> None:
    tip = KIEL.beam[2].length
    blind = [StrainGauge(beam=3, position=tip - 0.004, length=0.006)]
    assert warnings_of(replace(KIEL, strain_gauge=KIEL.strain_gauge + blind), basis) == [
        "strain_gauge[7] is blind: where it is, the strain is below 5 % of the largest of beam 3 in every one of the "
        "lowest modes"
    ]


def test_beams_apart_are_named() -> None:
    """A beam without a gauge or pair is seen and moved through its springs only."""
    alone = replace(
        KIEL,
        spring=[KIEL.spring[0]],
        patch=KIEL.patch[:3],
        strain_gauge=KIEL.strain_gauge[:4],
        point_of_interest=KIEL.point_of_interest[:3],
        actuator=None,
    )
    assert warnings_of(alone) == [
        "beam 3 is seen by no gauge, also not through springs",
        "beam 3 is moved by no patch pair, also not through springs",
    ]
    assert warnings_of(replace(alone, spring=KIEL.spring)) == []


def test_damping_ratios_stand_beside_their_own_frequencies() -> None:
    """With overdamped modes there are as many ratios as frequencies, and the real poles are apart."""
    made = compute_design(single_beam(viscous_damping=30.0), DesignOptions(reduced_modes=3))
    summary = made.summary
    ratios, frequencies = summary["damping_ratios"], summary["frequencies"]
    assert len(ratios) == len(frequencies) == 10
    overdamped = [k for k, ratio in enumerate(ratios) if ratio is None]
    assert overdamped
    assert len(summary["real_eigenvalues"]) == 2 * len(overdamped)
    assert all(value < 0 for value in summary["real_eigenvalues"])
    # viscous damping: zeta omega is about the same for every mode, so the slow ones are overdamped
    assert overdamped == list(range(len(overdamped)))
    decay = [ratio * omega for ratio, omega in zip(ratios, frequencies, strict=True) if ratio is not None]
    assert max(decay) < 4 * min(decay)


def test_no_velocity_weight_is_a_design() -> None:
    compute_design(KIEL, DesignOptions(weights=Weights(lqr_q_velocity=0.0)))


def chain(beams: int) -> Structure:
    """A row of beams, each a little different, with a pair, a point and a gauge each."""
    numbers = range(1, beams + 1)
    return Structure(
        beam=[replace(beam(1), tip_mass=0.02 + 0.001 * k) for k in numbers],
        patch=[patch(1, k, 0.02) for k in numbers],
        spring=[Spring(between=(k, k + 1), stiffness=5.0 + 0.2 * k) for k in range(1, beams)],
        point_of_interest=[point(k, 0.39) for k in numbers],
        strain_gauge=[gauge(k, 0.06) for k in numbers],
    )


def test_eight_beams_have_a_design_on_the_exact_basis() -> None:
    made = compute_design(chain(8), DesignOptions(basis="segment", gevrey_order=1.5))
    assert made.summary["reduced_order"] == 80


def test_too_many_modes_are_counted_as_the_option_counts() -> None:
    from flexbeams.plant.errors import DesignError

    with pytest.raises(DesignError, match=r"reduced_modes must be 1 to 10, modes of each beam .*, got 11$"):
        compute_design(KIEL, DesignOptions(reduced_modes=11))


def test_a_beam_of_one_piece_has_enough_unknowns() -> None:
    """Frequencies of a beam without patches beside one with, against the exact ones, to the eighth mode."""
    two = Structure(
        beam=[beam(1), beam(2)],
        patch=[patch(1, 1, 0.02)],
        spring=[Spring(between=(1, 2), stiffness=4.0)],
        point_of_interest=[point(1, 0.3)],
        strain_gauge=[gauge(1, 0.06)],
    )
    system = beam_model(two, "segment").assemble()
    found = undamped_frequencies(system)[:16]
    fine = undamped_frequencies(beam_model(two, "segment", 17).assemble())[:16]
    np.testing.assert_allclose(found, fine, rtol=1e-4)
