"""One absurd sample at any input of any unit: left out or refused with a line; it puts no voltage on a rail."""

import re
import struct
import zlib

import numpy as np
import pytest

from flexbeams.scenarios.simulation.failure import UnitFailure
from tests.helpers import UNITS, BuiltUnits, Workshop, design_of
from tests.native.workshop import NATIVE_UNITS, native_folder, needs_zig
from tests.units.loaded import Real, loaded

SAMPLE = 2e-4
ABSURD = (0.2, -1e3, 1e308, -1.7e308)
STRAINS = np.array([3e-5, -2e-5, 1e-5, 4e-5, -1e-5, 2e-5])


def recursion(y_pm: Real, beyond: Real) -> Real:
    """x_est after each tick with references and feedforward at zero, the samples `beyond` without a share in it."""
    a = design_of().arrays
    A, B, H, D, L, K, G = (
        a[k] for k in ("A_d", "B_d", "H_pm", "D_pm", "estimator_gain", "feedback_gain", "static_inverse")
    )
    x, u, integral, rows = np.zeros(30), np.zeros(4), np.zeros(4), []
    for y, out in zip(y_pm, beyond, strict=True):
        innovation = np.where(out, 0.0, y - H @ x - D @ u)
        x = A @ x + B @ u + L @ innovation
        commanded = integral - K @ x
        integral = integral - 1e-4 * G @ (a["H_pi"] @ x + a["D_pi"] @ u)
        u = commanded
        rows.append(x)
    assert np.abs(rows).max() < 1e3
    return np.array(rows)


def test_a_strain_beyond_the_limit_has_no_share_in_the_estimate(units: BuiltUnits) -> None:
    """The gauge's innovation is zero in that sample, the other gauges correct the estimate all the same."""
    rng = np.random.default_rng(5)
    y_pm = rng.normal(0.0, 3e-5, (120, 6))
    beyond = rng.uniform(size=y_pm.shape) < 0.1
    spiked = np.where(beyond, rng.choice(ABSURD, y_pm.shape), y_pm)
    expected = recursion(y_pm, beyond)
    with loaded(units("TrackingController")) as unit:
        unit.begin(integral_gain=1e-4)
        found = np.array([unit.advance(SAMPLE, y_pm=row).take("x_est") for row in spiked])
        assert unit.take("rejected_samples")[0] == beyond.sum()
        [line] = unit.notes
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    k, gauge = np.argwhere(beyond)[0]
    assert line == (
        f"unit: y_pm[{gauge + 1}] at {k * SAMPLE:.6g} s is left out of the estimate, as any sample beyond strain_limit "
        f"0.1, got {float(spiked[k, gauge])!r}"
    )


@pytest.mark.parametrize("gauge", [1, 3, 6])
def test_a_gauge_that_stays_beyond_ends_the_run(units: BuiltUnits, gauge: int) -> None:
    """With the rejected_limit-th sample in a row; one good sample in between starts the count again."""
    with loaded(units("TrackingController")) as unit:
        unit.begin(rejected_limit=7)
        bad = np.where(np.arange(1, 7) == gauge, -0.11, 0.0)
        for _ in range(6):
            unit.advance(SAMPLE, y_pm=bad)
        unit.advance(SAMPLE, y_pm=0.0)
        for _ in range(6):
            unit.advance(SAMPLE, y_pm=bad)
        before = unit.take("u", "y_est", "x_est")
        rule = (
            rf"y_pm\[{gauge}\] has been beyond strain_limit 0\.1 for 7 samples in a row \(rejected_limit\), got -0\.11"
        )
        with pytest.raises(UnitFailure, match=rule):
            unit.advance(SAMPLE)
        np.testing.assert_array_equal(unit.take("u", "y_est", "x_est"), before)
        assert unit.take("rejected_samples")[0] == 12
        unit.call("reset")
        assert unit.begin().advance(SAMPLE).take("rejected_samples")[0] == 0


def test_each_gauge_has_a_count_of_its_own(units: BuiltUnits) -> None:
    """A good sample starts a gauge's count again, also one that comes while another gauge is beyond the limit."""
    third, first = np.array([0.0, 0.0, -0.11, 0.0, 0.0, 0.0]), np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    with loaded(units("TrackingController")) as unit:
        unit.begin(rejected_limit=7)
        for row in (third, first) * 2:
            for _ in range(6):
                unit.advance(SAMPLE, y_pm=row)
        assert unit.take("rejected_samples")[0] == 24
        with pytest.raises(UnitFailure, match=r"y_pm\[1\] has been beyond .* for 7 samples in a row"):
            unit.advance(SAMPLE, y_pm=first + third)


def test_a_sample_at_the_limit_counts_beside_one_beyond(units: BuiltUnits) -> None:
    """The estimate takes it as if it were alone, in both directions."""
    limit = 0.01
    with loaded(units("TrackingController")) as unit:
        for sample in (limit, -limit):
            found = []
            for beside in (0.0, 0.011):
                unit.begin(strain_limit=limit).advance(SAMPLE, y_pm=[0.0, sample, 0.0, 0.0, 0.0, beside])
                assert unit.take("rejected_samples")[0] == (beside > limit)
                found.append(unit.take("x_est"))
                unit.call("reset")
            np.testing.assert_allclose(found[1], found[0], rtol=1e-12)
            assert found[0].any()


def test_the_count_is_part_of_the_state(units: BuiltUnits) -> None:
    with loaded(units("TrackingController")) as unit:
        unit.begin(rejected_limit=5).advance(3 * SAMPLE, y_pm=0.5)
        state = unit.saved()
        unit.advance(SAMPLE, y_pm=0.0)
        unit.restore(state).put("y_pm", 0.5)
        unit.advance(SAMPLE)
        with pytest.raises(UnitFailure, match="for 5 samples in a row"):
            unit.advance(SAMPLE)


@pytest.mark.parametrize(
    ("backend", "unit"),
    [*(pytest.param("native", u, marks=needs_zig) for u in NATIVE_UNITS), *(("python", u) for u in UNITS)],
)
def test_an_absurd_sample_is_refused_and_the_unit_works_again(backend: str, unit: str) -> None:
    """At each input but the strains: fmi2Error with a line, and after a reset the values of a run without it."""
    folder = native_folder(unit) if backend == "native" else Workshop().folder(unit)
    with loaded(folder) as one:

        def run() -> Real:
            return one.begin().advance(SAMPLE).advance(SAMPLE).everything()

        expected = run()
        names = [n for n, v in one.variables.items() if v.causality == "input" and "y_pm" not in n]
        assert names
        for name in names:
            for value in (1e308, -1e308, 1e5):
                one.call("reset")
                one.begin().advance(SAMPLE)
                before = one.everything()
                with pytest.raises(UnitFailure, match=r"must be [<>]="):
                    one.put(name, value)
                np.testing.assert_array_equal(one.everything(), before)
        one.call("reset")
        np.testing.assert_array_equal(run(), expected)


def overflowing(state: bytes, doubles: int) -> bytes:
    """A native state whose last doubles are huge, with a checksum that fits."""
    changed = bytearray(state)
    changed[-8 * doubles :] = struct.pack("<d", 1.5e308) * doubles
    changed[12:16] = struct.pack("<I", zlib.crc32(bytes(changed[16:])))
    return bytes(changed)


@needs_zig
def test_results_that_are_not_finite_end_the_step() -> None:
    """A plant that overflows all the same: one line, and its outputs keep their last values."""
    with loaded(native_folder("BeamPlant")) as one:
        one.begin().advance(SAMPLE, u=100.0)
        before = one.everything()
        state = one.saved()
        count = (len(state) - 384) // 8 - 2 * len(before) - 2
        one.restore(overflowing(state, count))
        held = one.take("y_pi", "y_pm", "w", "energy")
        with pytest.raises(UnitFailure, match=r"y_pi\[\d\] must be finite, a step gives (nan|-?inf): it keeps"):
            one.advance(SAMPLE)
        np.testing.assert_array_equal(one.take("y_pi", "y_pm", "w", "energy"), held)
        one.restore(state)
        np.testing.assert_array_equal(one.everything(), before)


@needs_zig
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(("name", "slope"), [("u[2]", 1e300), ("u[2]", 5.1e7), ("force[3]", 1e12)])
def test_input_derivatives_that_lead_beyond_are_refused(name: str, slope: float, sign: float) -> None:
    """In both directions, also a little; as far as the bound they are taken."""
    with loaded(native_folder("BeamPlant")) as one:
        one.begin()
        variable = one.variables[name]
        one.call("setRealInputDerivatives", [variable.valueReference], [1], [sign * slope])
        rule = rf"{re.escape(name)} must be within -{float(variable.max)}..{float(variable.max)} at the end of the step"
        with pytest.raises(UnitFailure, match=rule):
            one.advance(SAMPLE)
        one.call("reset")
        one.begin()
        one.call(
            "setRealInputDerivatives", [variable.valueReference], [1], [sign * 0.99 * float(variable.max) / SAMPLE]
        )
        one.advance(SAMPLE)


def test_a_first_sample_at_rest_stays_off_the_rails(units: BuiltUnits) -> None:
    """The case of a sample of 1e308 that put every voltage on a rail for ever: nothing moves at all."""
    with loaded(units("TrackingController")) as unit:
        unit.begin().advance(SAMPLE, y_pm=[1e308, 0.0, 0.0, 0.0, 0.0, 0.0])
        assert np.abs(unit.take("u")).max() == 0.0
        unit.advance(SAMPLE, y_pm=STRAINS).advance(SAMPLE)
        assert 0.0 < np.abs(unit.take("u")).max() < 100.0


@needs_zig
@pytest.mark.parametrize("share", [0.0, 0.05])
def test_spikes_among_the_samples_do_no_harm(share: float) -> None:
    """Scenario `tracking`, every strain replaced by a spike of 0.2 with a chance of 5 %: it ends within 0.05 mm."""
    rng = np.random.default_rng(6)
    target = np.array([-8e-3, 1e-3, 4e-3, -6e-3])
    with (
        loaded(native_folder("FlatnessFeedforward")) as feedforward,
        loaded(native_folder("TrackingController")) as controller,
        loaded(native_folder("BeamPlant")) as plant,
    ):
        feedforward.begin(transition_time=0.9, preview=SAMPLE)
        controller.begin()
        plant.begin()
        largest = 0.0
        for k in range(8000):
            if k == 500:
                feedforward.put("y_target", target)
            y_pm, u, u_ff, x_ref = (
                plant.take("y_pm"),
                controller.take("u"),
                feedforward.take("u_ff"),
                feedforward.take("x_ref"),
            )
            spikes = rng.uniform(size=6) < share
            controller.put("y_pm", np.where(spikes, rng.choice([-0.2, 0.2], 6), y_pm))
            controller.put("u_ff", u_ff)
            controller.put("x_ref", x_ref)
            plant.put("u", u)
            for unit in (feedforward, controller, plant):
                unit.advance(SAMPLE)
            largest = max(largest, float(np.abs(u).max()))
        rejected = controller.take("rejected_samples")[0]
        assert rejected == pytest.approx(share * 6 * 8000, rel=0.1)
        assert largest < 900.0  # of 1000 V
        assert np.abs(plant.take("y_pi") - target).max() < 1e-6  # a fiftieth of what was asked for
