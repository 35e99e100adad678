"""TrackingController against the recursion of filter, regulator and integral action, written down here again."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from tests.helpers import STRUCTURES, BuiltUnits, design_of
from tests.units.loaded import Loaded, Real, loaded

SAMPLE = 2e-4


@dataclass
class Recursion:
    """(42), (44), (45) tick by tick: u is the voltage that the last tick put out."""

    structure: str = "kiel"
    limit: float | Real = 1000.0
    lowest: float | Real | None = None  # where it is not -limit
    integral_gain: float = 1e-4
    feedback: bool = True
    x: Real = field(default_factory=lambda: np.zeros(0))
    u: Real = field(default_factory=lambda: np.zeros(0))
    integral: Real = field(default_factory=lambda: np.zeros(0))
    saturated: bool = False

    def begin(self, u_ff: Real, x_ref: Real) -> "Recursion":
        self.a = design_of(self.structure).arrays
        self.x, self.integral = x_ref.copy(), np.zeros(len(u_ff))
        self.put_out(u_ff)
        return self

    def put_out(self, wanted: Real) -> None:
        self.u = np.clip(wanted, -self.limit if self.lowest is None else self.lowest, self.limit)
        self.saturated = bool((self.u != wanted).any())

    def tick(self, y_pm: Real, u_ff: Real, x_ref: Real) -> None:
        a, before = self.a, self.u
        innovation = y_pm - a["H_pm"] @ self.x - a["D_pm"] @ before
        self.x = a["A_d"] @ self.x + a["B_d"] @ before + a["estimator_gain"] @ innovation
        error = x_ref - self.x
        wanted = u_ff + a["feedback_gain"] @ error + self.integral if self.feedback else u_ff
        missed = a["H_pi"] @ error + a["D_pi"] @ (u_ff - before)
        growth = self.integral_gain * a["static_inverse"] @ missed
        self.put_out(wanted)
        outward = (wanted - self.u) * growth > 0
        self.integral = self.integral + np.where(outward, 0.0, growth) if self.feedback else 0 * self.integral

    def values(self) -> Real:
        """u, y_est, saturated, x_est."""
        return np.concatenate([self.u, self.a["H_pi"] @ self.x + self.a["D_pi"] @ self.u, [self.saturated], self.x])


def signals(structure: str, steps: int) -> tuple[Real, Real, Real]:
    """Strains, feedforward voltages and reference states over some steps, unlike from one step to the next."""
    parts = design_of(structure).structure
    rng = np.random.default_rng(8)
    return (
        rng.normal(0, 3e-5, (steps, len(parts.strain_gauge))),
        rng.normal(0, 300, (steps, len(parts.patch))),
        rng.normal(0, 1e-2, (steps, 10 * len(parts.beam))),
    )


def shown(unit: Loaded) -> Real:
    return unit.take("u", "y_est", "saturated", "x_est")


def assert_same(found: Real, wanted: Real, n_u: int, n_pi: int) -> None:
    """Each signal to 1e-11 of its largest magnitude."""
    for part in (slice(0, n_u), slice(n_u, n_u + n_pi), slice(n_u + n_pi, n_u + n_pi + 1), slice(n_u + n_pi + 1, None)):
        np.testing.assert_allclose(found[:, part], wanted[:, part], rtol=0, atol=1e-11 * np.abs(wanted[:, part]).max())


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("limit", [1000.0, 350.0])
def test_runs_the_recursion(units: BuiltUnits, structure: str, limit: float) -> None:
    """After doStep(t_k, t_d) the outputs are those for t_{k+1}, from the measurement of t_k; with the limit in play."""
    y_pm, u_ff, x_ref = signals(structure, 200)
    n_u, n_pi = u_ff.shape[1], len(design_of(structure).structure.point_of_interest)
    other = Recursion(structure=structure, limit=limit).begin(u_ff[0], x_ref[0])
    with loaded(units("TrackingController", structure)) as unit:
        unit.begin(voltage_limit=limit, u_ff=u_ff[0], x_ref=x_ref[0])
        found, wanted = [shown(unit)], [other.values()]
        for row in zip(y_pm, u_ff, x_ref, strict=True):
            other.tick(*row)
            wanted.append(other.values())
            found.append(shown(unit.advance(SAMPLE, **dict(zip(("y_pm", "u_ff", "x_ref"), row, strict=True)))))
    assert_same(np.array(found), np.array(wanted), n_u, n_pi)
    saturated = np.array(wanted)[:, n_u + n_pi]
    assert saturated.any() or limit == 1000.0
    assert not saturated.all()


def test_limits_of_each_pair(units: BuiltUnits) -> None:
    """Those of a pair where they are narrower than that of all, on one side only; a pair may have to stay at zero."""
    y_pm, u_ff, x_ref = signals("kiel", 200)
    lowest, highest = np.array([-450.0, -80.0, 0.0, -450.0]), np.array([100.0, 450.0, 0.0, 450.0])
    other = Recursion(limit=highest, lowest=lowest).begin(u_ff[0], x_ref[0])
    with loaded(units("TrackingController")) as unit:
        unit.begin(
            voltage_limit=450.0,
            voltage_min=[-500.0, -80.0, 0.0, -1e4],
            voltage_max=[100.0, 450.0, 0.0, 1e308],
            u_ff=u_ff[0],
            x_ref=x_ref[0],
        )
        found, wanted, saturated = [shown(unit)], [other.values()], 0
        for k, row in enumerate(zip(y_pm, u_ff, x_ref, strict=True), 1):
            other.tick(*row)
            saturated += other.saturated
            wanted.append(other.values())
            found.append(shown(unit.advance(SAMPLE, **dict(zip(("y_pm", "u_ff", "x_ref"), row, strict=True)))))
            assert unit.take("saturation_share")[0] == saturated / k
    assert_same(np.array(found), np.array(wanted), 4, 4)
    u = np.array(wanted)[:, :4]
    assert (u == lowest).any(axis=0).all()
    assert (u == highest).any(axis=0).all()


def limits_in_force(unit: Loaded) -> tuple[Real, Real]:
    """What feedforward voltages far beyond are held at, lowest and highest, after a sample for each."""
    low = unit.advance(SAMPLE, u_ff=-1e4).take("u")
    return low, unit.advance(SAMPLE, u_ff=1e4).take("u")


def test_a_limit_narrows_at_once_and_widens_without_a_jump(units: BuiltUnits) -> None:
    """By the design's limit in 0.2 s, 1 V a sample, and not beyond what the parameters say."""
    with loaded(units("TrackingController")) as unit:
        unit.begin(feedback=False, u_ff=1e4)
        unit.put("voltage_max", [1e4, 300.0, 20.0, 0.0])
        assert unit.take("u").tolist() == [1000.0] * 4
        assert unit.advance(SAMPLE).take("u").tolist() == [1000.0, 300.0, 20.0, 0.0]
        unit.put("voltage_max", [1e4, 303.5, 1e4, 2.0])
        unit.put("voltage_limit", 990.0)
        found = [unit.advance(SAMPLE).take("u").tolist() for _ in range(5)]
        assert found == [[990.0, min(300.0 + k, 303.5), 20.0 + k, min(float(k), 2.0)] for k in range(1, 6)]
        assert unit.advance(1000 * SAMPLE).take("u").tolist() == [990.0, 303.5, 990.0, 2.0]
        unit.put("voltage_limit", 1500.0)
        unit.put("voltage_min[1]", -5.0)
        low, high = limits_in_force(unit)
        assert low.tolist() == [-5.0, -991.0, -991.0, -991.0]
        assert high.tolist() == [992.0, 303.5, 992.0, 2.0]


def test_limits_in_force_and_the_share_are_part_of_the_state(units: BuiltUnits) -> None:
    """Saved while they widen: the other instance goes on with the same bits; parameters and a reset start anew."""
    folder = units("TrackingController")
    y_pm, u_ff, x_ref = signals("kiel", 60)

    def row(k: int) -> dict[str, Real]:
        return {"y_pm": y_pm[k], "u_ff": 3 * u_ff[k], "x_ref": x_ref[k]}

    with loaded(folder) as one, loaded(folder) as other:
        one.begin(voltage_min=-1.5, voltage_max=[40.0, 30.0, 20.0, 10.0])
        for k in range(30):
            one.advance(SAMPLE, **row(k))
        one.put("voltage_min", -250.0)
        one.put("voltage_max", 1e4)
        for k in range(30, 40):
            one.advance(SAMPLE, **row(k))
        other.begin(voltage_limit=3.0).advance(SAMPLE)
        other.restore(one.saved())
        for k in range(40, 60):
            expected = one.advance(SAMPLE, **row(k)).everything()
            np.testing.assert_array_equal(other.advance(SAMPLE, **row(k)).everything(), expected)
        assert one.take("u").min() >= -1.5 - 30
        assert 0 < one.take("saturation_share")[0] <= 1
        one.call("reset")
        assert one.begin(u_ff=1e3).take("saturation_share", "u").tolist() == [0.0, *[1000.0] * 4]


@pytest.mark.parametrize("ticks", [1, 2, 5, 13])
def test_ticks_inside_a_long_step_run_with_inputs_held(units: BuiltUnits, ticks: int) -> None:
    y_pm, u_ff, x_ref = signals("kiel", 60)
    other = Recursion().begin(u_ff[0], x_ref[0])
    found, wanted = [], []
    with loaded(units("TrackingController")) as unit:
        unit.begin(u_ff=u_ff[0], x_ref=x_ref[0])
        for row in zip(y_pm, u_ff, x_ref, strict=True):
            for _ in range(ticks):
                other.tick(*row)
            wanted.append(other.values())
            found.append(shown(unit.advance(ticks * SAMPLE, **dict(zip(("y_pm", "u_ff", "x_ref"), row, strict=True)))))
    assert_same(np.array(found), np.array(wanted), 4, 4)


@pytest.mark.parametrize("steps", [(0.5,), (0.1,), (1.5,), (0.3, 0.7), (2.5, 0.25, 0.25), (1 / 3,)])
def test_tick_belongs_to_the_step_that_holds_its_time(units: BuiltUnits, steps: tuple[float, ...]) -> None:
    """A tick at t_i runs in the step [t, t + h) with t <= t_i < t + h, with the inputs of that step; counted, so that
    400 steps of a tenth of the sample time are 40 ticks."""
    y_pm, u_ff, x_ref = signals("kiel", 400)
    other = Recursion().begin(u_ff[0], x_ref[0])
    done, place, found, wanted = 0, 0.0, [], []
    with loaded(units("TrackingController")) as unit:
        unit.begin(u_ff=u_ff[0], x_ref=x_ref[0])
        for k, row in enumerate(zip(y_pm, u_ff, x_ref, strict=True)):
            step = steps[k % len(steps)]
            place += step
            while done < round(place, 6):
                other.tick(*row)
                done += 1
            wanted.append(other.values())
            found.append(shown(unit.advance(step * SAMPLE, **dict(zip(("y_pm", "u_ff", "x_ref"), row, strict=True)))))
    assert_same(np.array(found), np.array(wanted), 4, 4)


def test_ticks_are_counted_far_from_zero(units: BuiltUnits) -> None:
    """An hour in, one tick a step still: no time is accumulated."""
    y_pm, u_ff, x_ref = signals("kiel", 300)
    other = Recursion().begin(u_ff[0], x_ref[0])
    with loaded(units("TrackingController")) as unit:
        unit.begin(3600.0, u_ff=u_ff[0], x_ref=x_ref[0])
        for k, row in enumerate(zip(y_pm, u_ff, x_ref, strict=True)):
            other.tick(*row)
            unit.now = 3600.0 + k * SAMPLE
            unit.advance(SAMPLE, **dict(zip(("y_pm", "u_ff", "x_ref"), row, strict=True)))
            np.testing.assert_allclose(unit.take("x_est"), other.x, rtol=1e-9, atol=1e-12)


def test_without_feedback_the_feedforward_passes(units: BuiltUnits) -> None:
    """Within the limit as it is; the filter goes on; switched on again, feedback starts without integral."""
    y_pm, u_ff, x_ref = signals("kiel", 120)
    other = Recursion(limit=500.0, integral_gain=1e-3).begin(u_ff[0], x_ref[0])
    with loaded(units("TrackingController")) as unit:
        unit.begin(u_ff=u_ff[0], x_ref=x_ref[0], voltage_limit=500.0, integral_gain=1e-3)
        for k, row in enumerate(zip(y_pm, u_ff, x_ref, strict=True)):
            if k in (40, 80):
                other.feedback = not other.feedback
                unit.put("feedback", other.feedback)
            other.tick(*row)
            unit.advance(SAMPLE, **dict(zip(("y_pm", "u_ff", "x_ref"), row, strict=True)))
            np.testing.assert_allclose(shown(unit), other.values(), rtol=1e-9, atol=1e-12)
            if 40 <= k < 80:
                np.testing.assert_array_equal(unit.take("u"), np.clip(u_ff[k], -500, 500))


class ReducedPlant:
    """The reduced model as a plant whose voltages are held over a sample."""

    def __init__(self, structure: str = "kiel") -> None:
        self.a = design_of(structure).arrays
        self.x = np.zeros(len(self.a["A"]))

    def strain(self, u: Real) -> Real:
        return np.asarray(self.a["H_pm"] @ self.x + self.a["D_pm"] @ u)

    def advance(self, u: Real) -> None:
        self.x = self.a["A_d"] @ self.x + self.a["B_d"] @ u


def closed_loop(unit: Loaded, plant: ReducedPlant, u_ff: Real, x_ref: Real, steps: int) -> None:
    unit.put("u_ff", u_ff)
    unit.put("x_ref", x_ref)
    for _ in range(steps):
        u = unit.take("u")
        y_pm = plant.strain(u)
        plant.advance(u)
        unit.advance(SAMPLE, y_pm=y_pm)


@pytest.mark.parametrize(("gain", "left"), [(0.0, (0.2, 1.0)), (4e-4, (0.0, 2e-3))])
@pytest.mark.slow
def test_integral_action_removes_an_offset_the_estimate_shows(
    units: BuiltUnits, gain: float, left: tuple[float, float]
) -> None:
    """The reference state asks for a deflection that the feedforward's voltages, 20 % short, do not give."""
    a = design_of().arrays
    u_full = np.array([600.0, -500.0, -550.0, 520.0])
    x_ref = np.linalg.solve(a["A"], -a["B"] @ u_full)
    u_ff = 0.8 * u_full
    asked = a["H_pi"] @ x_ref + a["D_pi"] @ u_ff
    lacking = asked - (a["H_pi"] @ np.linalg.solve(a["A"], -a["B"] @ u_ff) + a["D_pi"] @ u_ff)
    plant = ReducedPlant()
    with loaded(units("TrackingController")) as unit:
        unit.begin(integral_gain=gain)
        closed_loop(unit, plant, u_ff, x_ref, 20_000)
        error = unit.take("y_est") - asked
        np.testing.assert_allclose(unit.take("x_est"), plant.x, atol=1e-6 * np.abs(plant.x).max())
    share = np.abs(error).max() / np.abs(lacking).max()
    assert left[0] <= share <= left[1]


@pytest.mark.slow
def test_anti_windup(units: BuiltUnits) -> None:
    """A reference beyond the limit for 2 s, then one within: the voltage leaves the limit within 20 ms.

    Without it the integral of the first voltage would have grown by some 2000 V meanwhile.
    """
    a = design_of().arrays
    u_far = np.array([1500.0, -400.0, -450.0, 420.0])
    near = 0.3 * u_far

    def rest(u: Real) -> Real:
        return np.asarray(np.linalg.solve(a["A"], -a["B"] @ u))

    plant = ReducedPlant()
    with loaded(units("TrackingController")) as unit:
        unit.begin(integral_gain=4e-4)
        closed_loop(unit, plant, u_far, rest(u_far), 10_000)
        assert unit.take("u")[0] == 1000.0
        assert unit.take("saturated")[0] == 1
        # The integral has not grown: what it holds shows at once where reference and estimate agree
        unit.put("integral_gain", 0.0)
        estimate = unit.take("x_est")
        u = unit.take("u")
        unit.advance(SAMPLE, x_ref=estimate, u_ff=np.zeros(4), y_pm=plant.strain(u))
        assert np.abs(unit.take("u")).max() < 60.0
        unit.put("integral_gain", 4e-4)
        closed_loop(unit, plant, near, rest(near), 100)
        assert unit.take("saturated")[0] == 0
        closed_loop(unit, plant, near, rest(near), 15_000)
        np.testing.assert_allclose(unit.take("y_est"), a["H_pi"] @ rest(near) + a["D_pi"] @ near, atol=2e-5)


def test_starts_on_the_reference(units: BuiltUnits) -> None:
    """At rest on a reference: nothing moves, since strains, estimate and voltages agree from the first tick on."""
    a = design_of().arrays
    u = np.array([300.0, -200.0, 100.0, 50.0])
    x = np.linalg.solve(a["A"], -a["B"] @ u)
    with loaded(units("TrackingController")) as unit:
        unit.begin(u_ff=u, x_ref=x)
        start = shown(unit)
        np.testing.assert_array_equal(unit.take("u"), u)
        np.testing.assert_array_equal(unit.take("x_est"), x)
        for _ in range(500):
            unit.advance(SAMPLE, y_pm=a["H_pm"] @ x + a["D_pm"] @ u)
        np.testing.assert_allclose(shown(unit), start, rtol=1e-7, atol=1e-9 * np.abs(x).max())


def test_start_voltage_beyond_the_limit_is_held_there(units: BuiltUnits) -> None:
    with loaded(units("TrackingController")) as unit:
        unit.begin(u_ff=[1200.0, -50.0, 0.0, -1e4])
        assert unit.take("u", "saturated").tolist() == [1000.0, -50.0, 0.0, -1000.0, 1.0]


def test_a_voltage_at_the_limit_is_not_saturated(units: BuiltUnits) -> None:
    limit = 350.0
    with loaded(units("TrackingController")) as unit:
        for u_ff, saturated in ((limit, 0.0), (-limit, 0.0), (np.nextafter(limit, np.inf), 1.0)):
            unit.begin(feedback=False, voltage_limit=limit, u_ff=[0.0, u_ff, 0.0, 0.0])
            for _ in range(2):  # at the start, and after a tick
                assert unit.take("saturated")[0] == saturated
                assert unit.take("u[2]")[0] == np.clip(u_ff, -limit, limit)
                unit.advance(SAMPLE)
            unit.call("reset")


def test_the_share_of_saturated_samples_counts_all_of_them(units: BuiltUnits) -> None:
    """Three of four at a limit, then none of four: 3/4, and 3/8 in the end."""
    with loaded(units("TrackingController")) as unit:
        unit.begin(feedback=False)
        shares = []
        for k in range(8):
            unit.advance(2e-4, u_ff=2000.0 if k < 3 else 100.0)
            unit.restore(unit.saved())
            shares.append(unit.take("saturation_share")[0])
    np.testing.assert_allclose(shares, [1, 1, 1, 3 / 4, 3 / 5, 3 / 6, 3 / 7, 3 / 8], rtol=1e-15)
