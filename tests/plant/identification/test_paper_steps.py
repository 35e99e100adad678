"""The paper's two steps: uncoupled beams, then springs; what they find, and how well they say it is known."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.method import Identification
from flexbeams.plant.identification.paper_steps import STATIC_SET, known_masses
from flexbeams.plant.identification.rest_positions import RestPosition, RestResiduals, rest_positions
from flexbeams.plant.identification.space import ParameterSpace, parameter_space
from flexbeams.plant.identification.steps_result import identify_in_steps
from flexbeams.plant.statespace import static_gains
from tests.oracles.examples import three_beams
from tests.plant.identification.data import HELD_BACK, PATTERNS, kiel, measured, responses, rms, steps

MASSES = tuple(f"beam[{k}].tip_mass" for k in (1, 2, 3))


@cache
def recorded(seed: int) -> tuple[Experiment, ...]:
    """Steps with the springs taken off, and with them."""
    structure, model = kiel()
    truth = structure.parameters()
    loose = {**truth, **{name: 0.0 for name in truth if name.startswith("spring[")}}
    off = [replace(e, uncoupled=True, name=f"off {e.name}") for e in steps(PATTERNS, 10, rows=1200)]
    return (
        *measured(model, loose, off, 0.005, seed),
        *measured(model, truth, steps(PATTERNS[:2], 10, rows=1200), 0.005, seed + 1000),
    )


def space_of(seed: int) -> tuple[object, ParameterSpace]:
    """A start 20 % off, with the tip masses known."""
    structure, rng = kiel()[0], np.random.default_rng(seed)
    start = structure.with_parameters(
        {n: v * (1 + 0.2 * rng.choice([-1, 1])) for n, v in structure.parameters().items() if n not in MASSES}
    )
    return start, parameter_space(start, known={name: structure.parameters()[name] for name in MASSES})


@cache
def identified(seed: int) -> Identification:
    start, space = space_of(seed)
    return identify_in_steps(start, recorded(seed), space)  # type: ignore[arg-type]


@pytest.mark.slow
def test_both_steps_give_the_parameters_back() -> None:
    structure, model = kiel()
    truth = structure.parameters()
    inside = []
    for seed in (0, 2):
        result = identified(seed)
        assert sum(abs(p.value / truth[p.name] - 1) < 0.02 for p in result.parameters) >= 20
        for p in result.parameters:
            if p.name in MASSES:
                assert (p.value, p.status, p.deviation) == (pytest.approx(truth[p.name], rel=1e-12), "known", 0.0)
            if p.name.startswith("spring["):
                assert p.value == pytest.approx(truth[p.name], rel=0.01)
            if p.status == "assumed":
                assert p.value == p.start
        inside += [abs(np.log(p.value / truth[p.name])) < 1.96 * p.deviation for p in result.fitted]
        wanted = responses(model, truth, steps(HELD_BACK, 10))[0]
        got = responses(model, result.structure.parameters(), steps(HELD_BACK, 10))[0]
        assert np.all(rms(got - wanted) < 0.06 * rms(wanted))
    assert np.mean(inside) > 0.88


@pytest.mark.slow
def test_undetermined_parameters_keep_their_start() -> None:
    assumed = {p.name for p in identified(0).parameters if p.status == "assumed"}
    assert {"patch[1].viscous_damping", "patch[2].viscous_damping", "patch[4].viscous_damping"} <= assumed
    assert not any(name.endswith(STATIC_SET) for name in assumed)


def case() -> tuple[RestResiduals, list[RestPosition]]:
    structure = three_beams()
    model = beam_model(structure, "clamped_free", 3)
    both = [
        RestPosition(
            voltages=np.array([300.0, -200.0, 100.0, 250.0]),
            sensors=(0, 3, 5, 9),
            means=np.array([1e-3, 2e-3, 1e-5, -1e-5]),
            errors=np.full(4, 1e-6),
            uncoupled=uncoupled,
        )
        for uncoupled in (True, False)
    ]
    free = [name for name in structure.parameters() if name.endswith((*STATIC_SET, "stiffness"))]
    space = parameter_space(structure, free=free)
    return RestResiduals(model, both, space, np.linspace(1e-5, 2e-5, 11)), both


def test_derivatives_of_rest_positions() -> None:
    """Against central differences with one extrapolation; springs that are off have none."""
    fit, both = case()
    x = 0.1 * np.random.default_rng(1).standard_normal(len(fit.space.names))
    got = fit.jacobian(x)
    for k in range(len(x)):

        def slope(h: float, k: int = k) -> np.ndarray:
            e = h * np.eye(len(x))[k]
            return np.asarray((fit.residuals(x + e) - fit.residuals(x - e)) / (2 * h))

        wanted = (4 * slope(1e-3) - slope(2e-3)) / 3
        assert got[:, k] == pytest.approx(wanted, rel=1e-7, abs=1e-7 * np.max(np.abs(wanted)))
    springs = [k for k, name in enumerate(fit.space.names) if name.startswith("spring[")]
    assert np.all(got[: len(both[0].means), springs] == 0)
    assert np.any(got[len(both[0].means) : 2 * len(both[0].means), springs] != 0)


def test_rest_positions_are_those_of_the_static_gains() -> None:
    structure, model = kiel()
    still = structure.with_parameters({n: 60 * v for n, v in structure.parameters().items() if n.endswith("damping")})
    data = measured(model, still.parameters(), steps(PATTERNS[:1], 10, rows=1200), 0.0, 1)
    [position] = rest_positions(data)
    wanted = np.concatenate([g @ PATTERNS[0] for g in static_gains(model, model.assemble())])
    assert position.means == pytest.approx(wanted, rel=1e-3, abs=1e-3 * np.max(np.abs(wanted[4:])))


def test_what_is_known_of_each_beam() -> None:
    structure = kiel()[0]
    masses = {name: structure.parameters()[name] for name in MASSES}
    found = known_masses(structure, parameter_space(structure, known=masses))
    assert list(found) == list(MASSES)
    assert "patch[2].density" in found[MASSES[1]]
    assert not any(name.startswith("spring[") for own in found.values() for name in own)
    modulus = {**masses, "beam[2].youngs_modulus": structure.beam[1].youngs_modulus}
    assert list(known_masses(structure, parameter_space(structure, known=modulus))) == [MASSES[0], MASSES[2]]
    for known, listed in (
        (
            {MASSES[0]: 0.02, MASSES[2]: 0.03},
            r"of beam 2 it has none: give, .* --known beam\[2\]\.tip_mass=0\.0394 alone",
        ),
        ({**masses, "beam[1].density": 1500.0}, r"of beam 1 it has beam\[1\].density, beam\[1\].tip_mass"),
    ):
        with pytest.raises(InputError, match=listed):
            known_masses(structure, parameter_space(structure, known=known))


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda e: [x for x in e if not x.uncoupled], "recorded with the springs taken off: give --uncoupled"),
        (lambda e: [x for x in e if x.uncoupled], "recorded with the springs attached, for step 2"),
        (lambda e: [replace(e[0], start="free"), *e[1:]], "off step 1: must start at rest and have no forces"),
        (lambda e: [replace(e[0], forces=np.ones((1200, 3))), *e[1:]], "off step 1: must start at rest"),
        (lambda e: [*e[:4], e[4].first(60)], "paper needs voltages that stay constant for seconds in the other files"),
    ],
)
def test_data_that_do_not_suit_the_steps(change: object, match: str) -> None:
    start, space = space_of(0)
    with pytest.raises(InputError, match=match):
        identify_in_steps(start, change(recorded(0)), space)  # type: ignore[arg-type, operator]
