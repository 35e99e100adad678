"""Free parameters, their coordinates, bounds and priors."""

import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.plant.identification.space import PRIOR, parameter_space, select
from tests.oracles.examples import single_beam, three_beams


def test_patterns_name_one_all_or_a_kind() -> None:
    structure = three_beams()
    assert select(structure, "beam[2].density") == ["beam[2].density"]
    assert select(structure, "patch[].piezo_ratio") == [f"patch[{k}].piezo_ratio" for k in range(1, 5)]
    assert select(structure, "patch[3].*") == [n for n in structure.parameters() if n.startswith("patch[3].")]
    assert len(select(structure, "*.structural_damping")) == 7
    assert len(select(structure, "*")) == len(structure.parameters())


def test_an_unknown_name_gets_the_nearest_one() -> None:
    with pytest.raises(InputError, match=r"beam\[1\]\.densty is not a parameter; did you mean 'beam\[1\]\.density'"):
        select(three_beams(), "beam[1].densty")


def test_coordinates_are_logarithms_around_the_start() -> None:
    structure = three_beams()
    space = parameter_space(structure, known={"spring[2].stiffness": 5.0})
    origin = space.values(np.zeros(len(space.names)))
    assert origin == {**structure.parameters(), "spring[2].stiffness": 5.0}
    x = np.linspace(-1, 1, len(space.names))
    values = space.values(x)
    assert np.allclose(space.coordinates(values), x, rtol=1e-12, atol=1e-12)
    assert values[space.names[0]] == pytest.approx(structure.parameters()[space.names[0]] * np.exp(-1), rel=1e-12)
    h = 1e-7
    for k, name in enumerate(space.names):
        up, down = x.copy(), x.copy()
        up[k] += h
        down[k] -= h
        slope = (space.values(up)[name] - space.values(down)[name]) / (2 * h)
        assert space.slopes(x)[k] == pytest.approx(slope, rel=1e-6)


def test_a_start_at_zero_is_linear_and_stays_non_negative() -> None:
    structure = single_beam(tip_mass=0.0)
    space = parameter_space(structure, free=["beam[1].tip_mass", "beam[1].viscous_damping"])
    assert list(space.logarithmic) == [False, True]
    assert space.lower[0] == 0
    x = np.array([0.5, 0.0])
    assert space.values(x)["beam[1].tip_mass"] == 0.5 * space.scale[0] > 0
    assert np.allclose(space.coordinates(space.values(x)), x)
    assert list(space.deviation) == [1.0, PRIOR]


def test_bounds_in_si_and_priors_in_shares() -> None:
    structure = single_beam()
    density = structure.beam[0].density
    space = parameter_space(
        structure,
        bounds={"beam[1].density": (density / 2, 3 * density), "beam[1].tip_mass": (0.0, 1.0)},
        priors={"beam[1].youngs_modulus": 0.05},
    )
    k = space.names.index("beam[1].density")
    assert (space.lower[k], space.upper[k]) == pytest.approx((-np.log(2), np.log(3)))
    assert space.lower[space.names.index("beam[1].tip_mass")] == -np.inf
    k = space.names.index("beam[1].youngs_modulus")
    assert space.deviation[k] == 0.05
    assert space.declared[k]
    assert np.sum(space.declared) == 1


@pytest.mark.parametrize(("low", "high"), [(2000.0, 3000.0), (100.0, 200.0)])
def test_bounds_that_exclude_the_start_are_refused(low: float, high: float) -> None:
    with pytest.raises(InputError, match=r"bounds of beam\[1\]\.density must enclose its start 1490, got"):
        parameter_space(single_beam(), bounds={"beam[1].density": (low, high)})


def test_nothing_to_identify_is_refused() -> None:
    structure = single_beam()
    with pytest.raises(InputError, match="no parameter is left to identify"):
        parameter_space(structure, known=structure.parameters())


def test_fixing_some_keeps_the_others() -> None:
    structure = three_beams()
    space = parameter_space(structure, priors={"patch[1].density": 0.1})
    smaller = space.without(
        {"beam[1].density", "spring[1].stiffness"}, {**structure.parameters(), "beam[1].density": 7}
    )
    assert len(smaller.names) == len(space.names) - 2
    assert smaller.fixed == {"beam[1].density": 7.0, "spring[1].stiffness": structure.spring[0].stiffness}
    assert smaller.deviation[smaller.names.index("patch[1].density")] == 0.1
    assert set(smaller.values(np.zeros(len(smaller.names)))) == set(structure.parameters())
