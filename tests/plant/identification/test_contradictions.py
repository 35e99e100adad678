"""Voltages and sensors with a wrong sign, unit or place, before a fit and after it."""

from dataclasses import replace

import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.identification.contradictions import require_consistent, warnings_of
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.method import Identification, identify
from flexbeams.plant.identification.plausibility import require_plausible
from flexbeams.plant.identification.quality import fits_of
from flexbeams.plant.identification.sensitivity import drive_of, modal_system, predict
from flexbeams.plant.identification.space import parameter_space
from tests.oracles.examples import single_beam
from tests.plant.identification.data import HELD_BACK, PATTERNS, Real, kiel, measured, steps

pytestmark = pytest.mark.slow

STRUCTURE, MODEL = kiel()


def driven(change: Real, patterns: Real = PATTERNS) -> list[Experiment]:
    """Data of the exact plant, the voltages changed after the recording."""
    data = measured(kiel("segment")[1], STRUCTURE.parameters(), steps(patterns, 10), 0.002, 1)
    return [replace(e, voltages=e.voltages @ change) for e in data]


def require(data: list[Experiment]) -> None:
    rng = np.random.default_rng(5)
    start = {name: v * np.exp(rng.uniform(-0.2, 0.2)) for name, v in STRUCTURE.parameters().items()}
    require_plausible(STRUCTURE.with_parameters(start), data, list(start))


def test_every_inverted_or_exchanged_voltage_is_found() -> None:
    for k in range(4):
        change = np.eye(4)
        change[k, k] = -1
        with pytest.raises(InputError, match=rf"column 'u\[{k + 1}\]' has the wrong sign.*u\[{k + 1}\]\*-1'"):
            require(driven(change))
        for m in range(k):
            with pytest.raises(InputError, match=rf"columns 'u\[{m + 1}\]' and 'u\[{k + 1}\]' are exchanged"):
                require(driven(np.eye(4)[[k if i == m else m if i == k else i for i in range(4)]]))


def test_voltages_in_another_unit_are_found() -> None:
    with pytest.raises(InputError, match=r"'u\[1\]' .*all sensors answer 1000 times.*--map 'u\[1\]=u\[1\]\*1000'"):
        require(driven(1e-3 * np.eye(4)))
    with pytest.raises(InputError, match=r"column 'u\[3\]' reaches 0\.8, .*--map 'u\[3\]=u\[3\]\*1000'"):
        require(driven(np.diag([1, 1, 1e-3, 1])))


def test_a_point_that_the_voltages_hardly_move_says_nothing_of_its_sign() -> None:
    """Under (48) point 2 is the small difference of large deflections."""
    data = driven(np.eye(4), HELD_BACK)
    rng = np.random.default_rng(0)
    for _ in range(10):
        start = {name: v * np.exp(rng.uniform(-0.3, 0.3)) for name, v in STRUCTURE.parameters().items()}
        require_plausible(STRUCTURE.with_parameters(start), data, list(start))


def swept(frequencies: tuple[float, float] = (1.0, 40.0)) -> list[Experiment]:
    """Linear sweeps through the first modes: above a resonance, sensors answer against their static gain."""
    experiments = steps(PATTERNS[:2], 10, rows=2000)
    first, last = frequencies
    for e in experiments:
        tau = e.time - 0.2
        e.voltages[:] *= np.sin(2 * np.pi * (first * tau + (last - first) * tau**2 / 20))[:, None]
    return measured(kiel("segment")[1], STRUCTURE.parameters(), experiments, 0.002, 1)


def test_sweeps_say_nothing_of_static_gains_but_of_sizes() -> None:
    data = swept()
    require(data)
    for column, factor, remedy in ((0, 1e3, "0.001"), (2, 1e2, "0.01"), (7, 1e6, "1e-06"), (9, 1e-3, "1000")):
        changed = [replace(e, outputs=np.where(np.arange(10) == column, factor, 1.0) * e.outputs) for e in data]
        with pytest.raises(InputError, match=rf"column '(y_p[im]\[\d\])' is .* wrong unit.*\*{remedy}'"):
            require(changed)
    require([*data, *driven(np.eye(4))])
    with pytest.raises(InputError, match=r"column 'u\[2\]' has the wrong sign"):
        require([*data, *driven(np.diag([1.0, -1, 1, 1]))])


def test_time_in_milliseconds_is_named() -> None:
    data = [replace(e, step=1e3 * e.step) for e in driven(np.eye(4))]
    with pytest.raises(InputError, match=r"if it is in ms, give --map 'time=time\*0\.001'"):
        require(data)
    with pytest.raises(InputError, match=r"needed are 10$"):
        require([e.first(40) for e in [replace(e, step=10 * e.step) for e in driven(np.eye(4))]])


def from_release(order: list[int], signs: list[int]) -> Identification:
    """A fit to free decays, which show no static answers, with sensors in another order and sign."""
    truth = single_beam()
    model = beam_model(truth, "clamped_free", 3)
    form, _ = modal_system(model, truth.parameters(), [])
    rng = np.random.default_rng(2)
    data = []
    for k, load in enumerate((0.1, -0.06)):
        e = replace(steps(np.zeros((1, 1)), 5, rows=400, step=2e-3)[0], start="free", name=f"release {k}")
        y = predict(form, [], drive_of(e, model), start=np.array([load, 1e-3 * k])).outputs.T
        y = y + 0.002 * np.max(np.abs(y), axis=0) * rng.standard_normal(y.shape)
        data.append(replace(e, outputs=y[:, order] * signs))
    free = ["beam[1].youngs_modulus", "beam[1].structural_damping"]
    start = truth.with_parameters({"beam[1].youngs_modulus": 1.1 * truth.beam[0].youngs_modulus})
    return identify(start, data, parameter_space(start, free=free), order=3)


def test_releases_give_the_parameters_and_no_warning() -> None:
    result = from_release([0, 1, 2, 3, 4], [1] * 5)
    require_consistent(result)
    assert warnings_of(result, fits_of(result)) == []
    assert result.structure.beam[0].youngs_modulus == pytest.approx(single_beam().beam[0].youngs_modulus, rel=1e-3)


@pytest.mark.parametrize(
    ("order", "signs", "match"),
    [
        ([0, 1, 2, 3, 4], [1, -1, 1, 1, 1], r"'y_pi\[[12]\]' has the wrong sign"),  # loads may change sign too
        ([1, 0, 2, 3, 4], [1] * 5, r"'y_pi\[1\]' and 'y_pi\[2\]' are exchanged"),
        ([0, 1, 2, 3, 4], [1, 1, 1, -1, 1], r"'y_pm\[\d\]' has the wrong sign"),
    ],
)
def test_a_finished_fit_shows_exchanged_and_inverted_sensors(order: list[int], signs: list[int], match: str) -> None:
    with pytest.raises(InputError, match=match):
        require_consistent(from_release(order, signs))
