"""Uncertainty: correlation of residuals, open directions, common factors of groups of beams."""

from dataclasses import replace

import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.identification.estimate import Search, Settings
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.information import information, open_directions
from flexbeams.plant.identification.noise import correlation_length
from flexbeams.plant.identification.residuals import Residuals, SensorModel
from flexbeams.plant.identification.scale import joined_beams, members, require_scale
from flexbeams.plant.identification.space import ParameterSpace, parameter_space
from tests.oracles.examples import five_beams, single_beam, three_beams
from tests.plant.identification.data import kiel, measured, steps


def test_white_noise_has_length_one_and_slow_noise_its_own() -> None:
    rng = np.random.default_rng(1)
    white = rng.standard_normal(20_000)
    assert correlation_length(white) == pytest.approx(1.0, abs=0.1)
    slow = np.zeros_like(white)
    for k in range(1, len(white)):
        slow[k] = 0.9 * slow[k - 1] + white[k]
    assert correlation_length(slow) == pytest.approx((1 + 0.81) / (1 - 0.81), rel=0.5)
    oscillation = np.sin(0.7 * np.arange(2000))
    assert correlation_length(oscillation) > 100
    assert correlation_length(np.zeros(100)) == 1.0


def test_open_directions_are_named_most_open_first() -> None:
    names = ("a", "b", "c")
    both = np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
    other = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    data = 4.0 * np.outer(both, both) + 1e6 * np.outer(other, other)
    first, second = open_directions(data, names, 0.1)
    assert first.deviation == np.inf
    assert first.shares == {"c": pytest.approx(1.0)}
    assert second.deviation == pytest.approx(0.5)
    assert abs(second.shares["a"] + second.shares["b"]) < 1e-9
    assert open_directions(data, names, 1e9)[0].shares == first.shares
    assert len(open_directions(data + 1e6 * np.eye(3), names, 0.1)) == 0


def linear_case() -> tuple[Residuals, np.ndarray, ParameterSpace]:
    """Piezo ratios only: outputs are linear in them, so that the covariance is known in closed form."""
    structure = single_beam()
    model = beam_model(structure, "clamped_free", 3)
    space = parameter_space(structure, free=["patch[1].piezo_ratio"], priors={"patch[1].piezo_ratio": 0.5})
    data = measured(model, structure.parameters(), steps(np.array([[500.0]]), 5, rows=400), 0.05, 3)
    search = Search(model, data, Settings(loss="linear", weights=np.ones(5)))
    residuals = search.residuals_of(data, space, search.rough_deviations())
    deviations = search.measured_deviations(residuals, np.zeros(1))
    return search.residuals_of(data, space, deviations), np.zeros(1), space


def test_the_deviation_of_a_linear_parameter_in_closed_form() -> None:
    residuals, x, space = linear_case()
    result = information(residuals, x, robust_scale=None)
    response = np.concatenate(
        [
            (p.parameters[0] / residuals.sensors.deviations[:, None]).ravel()
            for p in residuals.predictions(x, derivatives=True)
        ]
    )
    wanted = 1 / np.sqrt(np.sum((response * space.start[0]) ** 2) + 1 / 0.5**2)
    assert np.all(result.correlation_lengths < 1.1)
    assert result.deviations[0] == pytest.approx(wanted, rel=0.05)


def test_robust_loss_costs_little_and_outliers_do_not_enter() -> None:
    residuals, x, _ = linear_case()
    plain = information(residuals, x, robust_scale=None).deviations[0]
    robust = information(residuals, x, robust_scale=3.0).deviations[0]
    assert plain < robust < 1.05 * plain


def test_rows_that_stand_for_several() -> None:
    residuals, x, _ = linear_case()
    once = information(residuals, x, robust_scale=None)
    four = information(residuals, x, robust_scale=None, rows=4)
    assert np.allclose(four.data, 4 * once.data)


def test_groups_of_joined_beams() -> None:
    structure = five_beams()  # chain with a gap between beams 3 and 4
    whole = steps(np.ones((1, 6)), 6, rows=5)
    assert joined_beams(structure, whole) == [[1, 2, 3], [4, 5]]
    assert joined_beams(structure, [replace(whole[0], uncoupled=True)]) == [[1], [2], [3], [4], [5]]
    assert "patch[5].density" in members(structure, [4, 5])
    assert "spring[3].stiffness" in members(structure, [4, 5])
    assert "spring[1].stiffness" not in members(structure, [4, 5])
    assert len(members(structure, [1, 2, 3])) + len(members(structure, [4, 5])) == len(structure.parameters())


def residuals_for(space: ParameterSpace, experiments: list[Experiment]) -> Residuals:
    structure, model = kiel()
    data = measured(model, structure.parameters(), experiments, 0.005, 1)
    search = Search(model, data, Settings())
    return search.residuals_of(data, space, search.rough_deviations())


def test_what_settles_the_scale() -> None:
    structure, _ = kiel()
    experiments = steps(np.array([[800.0, 500, -300, 400]]), 10, rows=200)
    origin = np.zeros(len(structure.parameters()))
    with pytest.raises(InputError, match=r"beams 1, 2, 3 .* --known beam\[1\]\.tip_mass=0\.0202"):
        require_scale(structure, residuals_for(parameter_space(structure), experiments), origin)
    for options in (
        {"known": {"beam[2].tip_mass": 0.0394}},
        {"known": {"spring[1].stiffness": 7.53}},
        {"priors": {"beam[1].density": 0.05}},
    ):
        space = parameter_space(structure, **options)  # type: ignore[arg-type]
        require_scale(structure, residuals_for(space, experiments), np.zeros(len(space.names)))
    forces = np.zeros((200, 3))
    forces[20:24, 1] = 2.0
    blow = [replace(experiments[0], forces=forces)]
    require_scale(structure, residuals_for(parameter_space(structure), blow), origin)


def test_a_known_value_that_the_data_hardly_feel_settles_nothing() -> None:
    structure, _ = kiel()
    space = parameter_space(structure, known={"patch[2].viscous_damping": 0.0277})
    with pytest.raises(InputError, match="common factor"):
        require_scale(
            structure,
            residuals_for(space, steps(np.array([[800.0, 500, -300, 400]]), 10, rows=200)),
            np.zeros(len(space.names)),
        )


def test_uncoupled_beams_need_a_known_value_each() -> None:
    structure, _ = kiel()
    experiments = [replace(e, uncoupled=True) for e in steps(np.array([[800.0, 500, -300, 400]]), 10, rows=200)]
    space = parameter_space(structure, known={"beam[1].tip_mass": 0.0202, "beam[3].tip_mass": 0.0282})
    with pytest.raises(InputError, match=r"of beam 2 are known .* --known beam\[2\]\.tip_mass=0\.0394"):
        require_scale(structure, residuals_for(space, experiments), np.zeros(len(space.names)))


def test_three_beams_have_one_group() -> None:
    assert joined_beams(three_beams(), steps(np.ones((1, 4)), 11, rows=5)) == [[1, 2, 3]]
    assert SensorModel(deviations=np.ones(2), delays=np.zeros(2)).fit_delays is False
