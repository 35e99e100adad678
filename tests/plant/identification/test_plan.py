"""Plans of experiments: responses add up, exchanges gain, and limits hold."""

from functools import cache

import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.plant.galerkin import BeamModel, beam_model
from flexbeams.plant.identification.expectation import expectation
from flexbeams.plant.identification.plan import Candidates, Search, Segment, candidates, record
from flexbeams.plant.identification.space import ParameterSpace, parameter_space
from tests.oracles.examples import three_beams

NOISE = np.concatenate([np.full(4, 2e-5), np.full(7, 5e-7)])
COUNT = 3


@cache
def case(reach: float = 1.0) -> tuple[BeamModel, ParameterSpace, Candidates, Search]:
    structure = three_beams()
    model = beam_model(structure, "clamped_free", 3)
    kinds = ("tip_mass", "youngs_modulus", "structural_damping", "piezo_ratio", "stiffness")
    free = [name for name in structure.parameters() if name.endswith(kinds)]
    space = parameter_space(structure, free=free, known={"beam[1].tip_mass": structure.beam[0].tip_mass})
    signals = candidates(model, space, duration=0.6, step=4e-3, sweeps=True, steps=True)
    search = Search(model, space, signals, COUNT, deviations=NOISE, limit=500.0, deflection_limit=reach)
    return model, space, signals, search


def size(segments: list[Segment], reach: float = 1.0) -> float:
    model, space, signals, search = case()
    _, experiment = record(model, space, segments, signals, reach)
    return search.size(expectation(model, space, experiment, NOISE).data)


def test_the_search_sees_the_exact_information_of_a_record() -> None:
    """Its thinned, shifted responses against the Jacobian of the whole record."""
    model, _, _, search = case()
    assert len(NOISE) == len(model.deflection) + len(model.strain)
    rng = np.random.default_rng(1)
    for _ in range(3):
        kinds, levels = rng.integers(3, size=COUNT), rng.choice([-1.0, 0.5, 1.0], size=(COUNT, 4))
        state = search.record_of(kinds, levels)
        guided = np.exp(-search.value_of(state))
        assert guided == pytest.approx(size(search.segments_of(kinds, levels)), rel=0.05)


def test_exchanges_gain_and_no_single_exchange_is_left() -> None:
    _, _, _, search = case()
    trials = search.trials(seed=2)
    assert trials == search.trials(seed=2)
    best = min(map(size, trials))
    simple = [size(segments) for segments in search.simple().values()]
    rng = np.random.default_rng(3)
    others = [
        size(search.segments_of(rng.integers(3, size=COUNT), rng.choice([-1.0, 1.0], size=(COUNT, 4))))
        for _ in range(10)
    ]
    assert best < 0.7 * min(simple)
    assert best < min(others)


def test_the_criteria_are_those_of_a_diagonal_information_in_closed_form() -> None:
    model, space, signals, search = case()
    p = len(space.names)
    data = np.diag(np.linspace(1, 4, p)) - np.diag(1 / space.deviation**2)
    assert search.size(data) == pytest.approx(np.exp(-0.5 * np.mean(np.log(np.linspace(1, 4, p)))))
    mean = Search(model, space, signals, COUNT, deviations=NOISE, limit=1.0, deflection_limit=1.0, criterion="A").size(
        data
    )
    assert mean == pytest.approx(np.sqrt(np.mean(1 / np.linspace(1, 4, p))))


def test_limits_hold() -> None:
    model, space, signals, search = case(reach=2e-3)
    segments = min(search.trials(), key=lambda s: size(s, 2e-3))
    scaled, experiment = record(model, space, segments, signals, 2e-3)
    assert np.max(np.abs(experiment.outputs[:, :4])) <= 2e-3 * (1 + 1e-12)
    assert np.max(np.abs(experiment.voltages)) <= 500.0
    assert max(abs(v) for s in scaled for v in s.voltages) == pytest.approx(
        max(abs(v) for s in segments for v in s.voltages) * 2e-3 / _reached(segments)
    )
    assert np.all(experiment.voltages[0] == 0)
    assert np.all(experiment.voltages[-1] == 0)


def _reached(segments: list[Segment]) -> float:
    model, space, signals, _ = case()
    _, whole = record(model, space, segments, signals, 1e9)
    return float(np.max(np.abs(whole.outputs[:, :4])))


def test_sweeps_start_and_end_where_they_say() -> None:
    _, _, signals, _ = case()
    assert signals.names[0] == "step"
    assert [name.split()[:2] for name in signals.names[1:]] == [["sweep", "to"]] * 2
    for name, values in zip(signals.names[1:], signals.values[1:], strict=True):
        last = float(name.split()[2])
        crossings = np.count_nonzero(np.diff(np.sign(values)))
        assert crossings / 2 == pytest.approx(0.6 * last / 2, abs=2.0)  # mean of the linear sweep


def test_an_open_scale_is_refused() -> None:
    structure = three_beams()
    model, _, signals, search = case()
    segments = next(iter(search.simple().values()))
    space = parameter_space(structure)
    _, experiment = record(model, space, segments, signals, 1.0)
    with pytest.raises(InputError, match=r"common factor .* --known beam\[1\]\.tip_mass"):
        expectation(model, space, experiment, NOISE)
