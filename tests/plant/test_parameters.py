"""The table of physical parameters against the structures and models that read it."""

import pytest

from flexbeams.fmus.interface.si import SI_UNITS
from flexbeams.plant.choices import BASES, BasisName
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.parameters import PARAMETERS, in_unit_order, parameter
from flexbeams.plant.structure import Structure
from tests.oracles.examples import five_beams, single_beam, three_beams


@pytest.mark.parametrize("structure", [single_beam(), three_beams(), five_beams()])
@pytest.mark.parametrize("basis", BASES)
def test_each_parameter_enters_one_matrix(structure: Structure, basis: BasisName) -> None:
    model = beam_model(structure, basis)
    assert sorted(term.parameter for term in model.terms) == sorted(model.structure.parameters())


def test_units_list_a_parameter_of_every_part_before_the_next() -> None:
    names = [name for name, _ in in_unit_order(three_beams().parameters())]
    assert sorted(names) == sorted(three_beams().parameters())
    assert names[:4] == ["beam[1].density", "beam[2].density", "beam[3].density", "beam[1].youngs_modulus"]
    assert names[-2:] == ["spring[1].stiffness", "spring[2].stiffness"]
    assert [name for name, _ in in_unit_order(single_beam().parameters())][-1] == "patch[1].piezo_ratio"


def test_units_of_measurement_are_those_of_the_fmus() -> None:
    assert {entry.unit for entry in PARAMETERS} <= set(SI_UNITS)


def test_what_may_vanish() -> None:
    """Without damping, tip masses and springs a structure still moves; without mass or piezo effect it does not."""
    assert {entry.name for entry in PARAMETERS if entry.may_vanish} == {
        "tip_mass",
        "viscous_damping",
        "structural_damping",
        "stiffness",
    }
    assert parameter("beam", "tip_mass").rule == "must be finite and >= 0"
    assert parameter("beam", "density").rule == "must be finite and > 0"
    with pytest.raises(KeyError, match=r"spring\[\]\.length"):
        parameter("spring", "length")
