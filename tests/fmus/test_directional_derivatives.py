"""Directional derivatives against differences of getters and setters in the same mode, and against the matrices."""

from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest

from flexbeams.scenarios.simulation.failure import UnitFailure
from tests.helpers import Workshop, design_of
from tests.native.workshop import native_folder
from tests.units.loaded import Loaded, Real, loaded

pytestmark = pytest.mark.native

H = 2e-4
_PATCHES = {
    f"history[{k},{i}]": voltage
    for k, row in enumerate(
        (
            [930.0, -70.0, 230.0, 80.0],
            [-930.0, 70.0, -230.0, -80.0],
            [150.0, 0.0, 50.0, 30.0],
            [250.0, 100.0, 150.0, 130.0],
        ),
        1,
    )
    for i, voltage in enumerate(row, 1)
}  # no play operator is about to move at these voltages, where the derivative jumps
POINT = {
    "BeamPlant": {
        "start_at_rest_under": np.array([300.0, -120.0, 500.0, 40.0]),
        "strain_noise_std": 2e-7,
        "noise_seed": 5,
        "spring[2].stiffness": 8.0,
    },
    "FlatnessFeedforward": {"y_target": np.array([-8e-3, 1e-3, 4e-3, -6e-3]), "preview": 0.01},
    "TrackingController": {
        "u_ff": np.array([300.0, 900.0, -950.0, 20.0]),
        "x_ref": np.linspace(-0.1, 0.2, 30),
        "voltage_limit": 800.0,
        "voltage_max[1]": 250.0,
        "voltage_min[3]": -700.0,
    },
    "MfcActuator": {**_PATCHES, "lag": 1e-3, "slew_rate": 1e5, "resolution": 1.0},
    "MfcCompensator": _PATCHES,
    "BeamClosedLoop": {
        "y_target": np.array([-8e-3, 1e-3, 4e-3, -6e-3]),
        "plant.start_at_rest_under": np.array([300.0, -120.0, 500.0, 40.0]),
        "plant.strain_noise_std": 2e-7,
        "feedforward.preview": 0.01,
        "controller.voltage_limit": 300.0,
    },
}  # at which the derivatives are taken: some voltages at the limit, parameters off their start values

# Knowns at least that first outputs depend on
MOVED = {"BeamPlant": 20, "FlatnessFeedforward": 4, "TrackingController": 18, "BeamClosedLoop": 20}
MOVED |= {"MfcActuator": 60, "MfcCompensator": 4}


def references(unit: Loaded, causality: str) -> list[int]:
    return [v.valueReference for v in unit.variables.values() if v.causality == causality and v.type == "Real"]


def derivative(unit: Loaded, unknowns: list[int], knowns: list[int], changes: list[float]) -> Real:
    return np.array(unit.call("getDirectionalDerivative", unknowns, knowns, changes))


def jacobian(unit: Loaded, unknowns: list[int], knowns: list[int]) -> Real:
    """(unknowns, knowns)"""
    return np.array([derivative(unit, unknowns, [known], [1.0]) for known in knowns]).T


def scales(unit: Loaded, unknowns: list[int]) -> Real:
    """The largest magnitude in the array of each unknown."""
    names = {v.valueReference: v.name.partition("[")[0] for v in unit.variables.values()}
    values = np.abs(unit.call("getReal", unknowns))
    arrays = np.array([names[k] for k in unknowns])
    return np.array([values[arrays == name].max() for name in arrays])


def differences(unit: Loaded, unknowns: list[int], known: int) -> tuple[Real, float]:
    """Central differences extrapolated to step 0 (Richardson), of the outputs as they follow what is set.

    Also the magnitude of the known, or 20 times the largest step.
    """
    [before] = unit.call("getReal", [known])
    variable = next(v for v in unit.variables.values() if v.valueReference == known)
    low, high = float(variable.min or "-inf"), float(variable.max or "inf")
    widest = 0.05 * min(abs(before) or 1.0, before - low or np.inf, high - before or np.inf)
    rows = []
    for k in range(6):
        values = []
        for sign in (-1, 1):
            unit.call("setReal", [known], [before + sign * widest / 2**k])
            values.append(np.array(unit.call("getReal", unknowns)))
        rows.append((values[1] - values[0]) * 2**k / (2 * widest))
    unit.call("setReal", [known], [before])
    for order in range(1, len(rows)):
        rows = [(4**order * fine - coarse) / (4**order - 1) for coarse, fine in pairwise(rows)]
    return np.asarray(rows[0]), max(abs(before), 20 * widest)


@pytest.mark.parametrize("unit", POINT)
def test_differences_of_first_outputs(unit: str) -> None:
    """For every input and Real parameter, as relative changes: 1e-10 of the largest value of each array of outputs."""
    with loaded(native_folder(unit)) as one:
        one.prepare(**POINT[unit])
        unknowns = references(one, "output")
        scale = scales(one, unknowns)
        moved = set()
        for known in references(one, "input") + references(one, "parameter"):
            expected, size = differences(one, unknowns, known)
            [found] = jacobian(one, unknowns, [known]).T
            assert (np.abs(found - expected) * size / scale).max() < 1e-10, known
            moved |= {known} if expected.any() else set()
    assert len(moved) >= MOVED[unit]


def test_the_plant_at_rest_by_its_matrices() -> None:
    """y = C q with K q = L u, whose K and L are linear in each parameter."""
    model = design_of().model()
    u = POINT["BeamPlant"]["start_at_rest_under"]
    own = {"spring[2].stiffness": 8.0}
    system = model.assemble(own)
    rows = np.vstack([model.deflection, model.strain])
    q = np.linalg.solve(system.K, system.L @ u)
    with loaded(native_folder("BeamPlant")) as one:
        one.prepare(**POINT["BeamPlant"])
        unknowns = references(one, "output")
        names = [n for n in one.variables if n.partition("[")[0] in ("beam", "patch", "spring")]
        for name in names:
            known = one.variables[name].valueReference
            [value] = one.call("getReal", [known])
            other = model.assemble({**own, name: 2 * value})
            expected = rows @ np.linalg.solve(system.K, (other.L - system.L) @ u - (other.K - system.K) @ q)
            [found] = jacobian(one, unknowns, [known]).T
            np.testing.assert_allclose(found * value, expected, rtol=0, atol=1e-10 * np.abs(rows @ q).max())
        voltages = [one.variables[f"start_at_rest_under[{k}]"].valueReference for k in range(1, 5)]
        expected = rows @ np.linalg.solve(system.K, system.L)
        np.testing.assert_allclose(jacobian(one, unknowns, voltages), expected, rtol=0, atol=1e-10)
        held = references(one, "input")
        assert not jacobian(one, unknowns, held).any()


def test_feedforward_and_controller_by_their_matrices() -> None:
    a = design_of().arrays
    n, inverse = len(a["A_d"]), a["static_inverse"]
    with loaded(native_folder("FlatnessFeedforward")) as one:
        one.prepare(**POINT["FlatnessFeedforward"])
        found = jacobian(one, references(one, "output"), references(one, "input"))
        at_rest = np.linalg.solve(np.eye(n) - a["A_d"], a["B_d"]) @ inverse
        expected = np.vstack([inverse, at_rest, a["H_pi"] @ at_rest + a["D_pi"] @ inverse])
        for part in (slice(0, 4), slice(4, 4 + n), slice(4 + n, None)):
            np.testing.assert_allclose(found[part], expected[part], rtol=0, atol=1e-10 * np.abs(expected[part]).max())
    with loaded(native_folder("TrackingController")) as one:
        one.prepare(**POINT["TrackingController"])
        found = jacobian(one, references(one, "output"), references(one, "input"))
        within = np.diag([0.0, 0.0, 0.0, 1.0])  # by the limit of 800 V, and those of pairs 1 and 3
        strains = np.zeros((4, 6))
        np.testing.assert_array_equal(found[:4], np.hstack([strains, within, np.zeros((4, n))]))
        expected = np.hstack([strains, a["D_pi"] @ within, a["H_pi"]])
        np.testing.assert_allclose(found[4:], expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("unit", POINT)
def test_outputs_follow_states_once_initialised(unit: str) -> None:
    """In step mode a new input changes no output before the next step, and the derivatives say so."""
    with loaded(native_folder(unit)) as one:
        one.begin(**POINT[unit]).advance(H)
        unknowns, knowns = references(one, "output"), [0, *references(one, "input")]
        before = one.call("getReal", unknowns)
        assert not jacobian(one, unknowns, knowns).any()
        for known in knowns[1:]:
            [value] = one.call("getReal", [known])
            one.call("setReal", [known], [0.9 * value + 1e-5])
        assert one.call("getReal", unknowns) == before
        content = one.saved()
        one.advance(H)
        after = one.everything()
        one.restore(content)
        assert not jacobian(one, unknowns, knowns).any()
        np.testing.assert_array_equal(one.advance(H).everything(), after)
        one.call("terminate")
        assert not jacobian(one, unknowns, knowns).any()


@pytest.mark.parametrize("unit", POINT)
def test_derivatives_agree_with_the_dependencies_that_the_unit_declares(unit: str) -> None:
    """A derivative that is not zero belongs to a dependency, in each mode."""
    folder = native_folder(unit)
    root = ElementTree.parse(folder / "modelDescription.xml").getroot()
    declared = {
        section: {
            int(u.get("index", "")) - 1: [int(k) - 1 for k in u.get("dependencies", "").split()]
            for u in root.findall(f"ModelStructure/{section}/Unknown")
        }
        for section in ("Outputs", "InitialUnknowns")
    }
    assert root.find("CoSimulation").get("providesDirectionalDerivative") == "true"  # type: ignore[union-attr]
    with loaded(folder) as one:
        one.prepare(**POINT[unit])
        unknowns, knowns = references(one, "output"), [0, *references(one, "input"), *references(one, "parameter")]
        matrix = jacobian(one, unknowns, knowns)
        for row, unknown in zip(matrix, unknowns, strict=True):
            assert {knowns[k] for k in np.flatnonzero(row)} <= set(declared["InitialUnknowns"][unknown])
    assert not any(declared["Outputs"].values())


def test_several_changes_add_up() -> None:
    """One direction of all knowns, one of them named twice, and unknowns in any order."""
    with loaded(native_folder("BeamPlant")) as one:
        one.prepare(**POINT["BeamPlant"])
        unknowns, knowns = references(one, "output"), references(one, "parameter")
        changes = np.random.default_rng(2).normal(size=len(knowns)) * one.call("getReal", knowns)
        matrix = jacobian(one, unknowns, knowns)
        found = derivative(one, unknowns[::-1], [*knowns, knowns[0]], [*changes.tolist(), 0.5])
        expected = (matrix @ changes + 0.5 * matrix[:, 0])[::-1]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
        assert not derivative(one, unknowns, [], []).any()


@pytest.mark.parametrize("unit", ["BeamPlant", "BeamClosedLoop"])
def test_what_is_not_asked_rightly_is_refused_and_the_instance_goes_on(unit: str) -> None:
    with loaded(native_folder(unit)) as one:
        name = {n.rpartition(".")[2]: n for n in one.variables}
        known, unknown = (one.variables[n].valueReference for n in ("force[1]", "y_pi[1]"))
        parameter = one.variables[name["strain_noise_std"]].valueReference
        whole = one.variables[name["noise_seed"]].valueReference
        local = one.variables[name["energy"]].valueReference
        with pytest.raises(UnitFailure, match="is for instances in initialization mode and later, this one is just"):
            derivative(one, [unknown], [known], [1.0])
        one.prepare()
        cases = [
            ([known], [known], 1.0, r"force\[1\] is input, unknowns are outputs"),
            ([local], [known], 1.0, r"energy is local, unknowns are outputs"),
            ([unknown], [unknown], 1.0, r"y_pi\[1\] is output, knowns are inputs, parameters and time"),
            ([unknown], [whole], 1.0, r"noise_seed is Integer, got a call for Real"),
            ([unknown], [10**6], 1.0, r"value reference must be within 0\.\."),
            ([unknown], [known], np.nan, r"change of force\[1\] must be finite, got nan"),
        ]
        for unknowns, knowns, change, text in cases:
            with pytest.raises(UnitFailure, match=text):
                derivative(one, unknowns, knowns, [change])
        one.call("exitInitializationMode")
        with pytest.raises(UnitFailure, match="strain_noise_std is parameter, knowns are inputs and time"):
            derivative(one, [unknown], [parameter], [1.0])
        one.advance(H)
        assert np.isfinite(one.everything()).all()


def test_a_derivative_that_overflows_is_refused() -> None:
    with loaded(native_folder("FlatnessFeedforward")) as one:
        one.prepare()
        unknowns, knowns = references(one, "output"), references(one, "input")
        with pytest.raises(UnitFailure, match=r"change of u_ff\[\d\] is beyond the range of doubles"):
            derivative(one, unknowns, knowns, [1e308] * len(knowns))
        assert np.isfinite(derivative(one, unknowns, knowns, [1.0] * len(knowns))).all()


def test_python_units_declare_that_they_have_none() -> None:
    """pythonfmu's wrapper answers the call itself, and not with a derivative."""
    root = ElementTree.parse(Workshop().folder("BeamPlant") / "modelDescription.xml").getroot()
    assert root.find("CoSimulation").get("providesDirectionalDerivative") == "false"  # type: ignore[union-attr]
