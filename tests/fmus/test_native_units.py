"""The native units compute what the Python units compute, for any structure, basis, parameter and step."""

from collections.abc import Callable
from contextlib import ExitStack

import numpy as np
import pytest

from flexbeams.plant.basis import Array
from tests.helpers import STRUCTURES, UNITS, Workshop, design_of
from tests.native.workshop import native_folder
from tests.units.loaded import Loaded, loaded

SAMPLE = 2e-4
pytestmark = pytest.mark.native

Excitation = Callable[[Loaded, int], None]


def record(unit: Loaded, steps: int, step: float, excite: Excitation) -> Array:
    """Every value after each step, (steps + 1, variables)."""
    rows = [unit.everything()]
    for k in range(steps):
        excite(unit, k)
        unit.advance(step)
        rows.append(unit.everything())
    return np.array(rows)


def difference(one: Array, other: Array) -> float:
    """Largest deviation of a column, relative to its largest value."""
    scale = np.max(np.abs(other), axis=0)
    return float(np.max(np.max(np.abs(one - other), axis=0) / np.where(scale > 0, scale, 1.0)))


def excitation(unit: str, structure: str = "kiel") -> Excitation:
    """Inputs that change every 25 steps: plant and controller are shaken, the feedforward gets new targets."""
    design = design_of(structure)
    inverse = design.arrays["static_inverse"]
    n_u, n_pi = inverse.shape
    rng = np.random.default_rng(11)
    voltages = rng.normal(0.0, 200.0, (400, n_u))
    forces = rng.normal(0.0, 0.05, (400, len(design.structure.beam)))
    strains = rng.normal(0.0, 2e-4, (400, len(design.arrays["H_pm"])))
    references = rng.normal(0.0, 1e-3, (400, len(design.arrays["A"])))
    gain = np.linalg.pinv(inverse)
    targets = {100: gain @ voltages[0], 700: gain @ voltages[1], 1500: 20 * gain @ voltages[2], 1600: np.zeros(n_pi)}

    def excite(instance: Loaded, k: int) -> None:
        if unit == "FlatnessFeedforward":
            if k in targets:
                instance.put("y_target", targets[k])
        elif k % 25 == 0 and unit != "TrackingController":
            instance.put("u_eff" if unit == "MfcCompensator" else "u", voltages[k // 25])
            if unit == "BeamPlant":
                instance.put("force", forces[k // 25])
        elif k % 25 == 0:
            instance.put("y_pm", strains[k // 25])
            instance.put("u_ff", 3 * voltages[k // 25])
            instance.put("x_ref", references[k // 25])

    return excite


def both(
    workshop: Workshop,
    unit: str,
    steps: int,
    step: float = SAMPLE,
    structure: str = "kiel",
    basis: str = "clamped_free",
    **starts: object,
) -> tuple[Array, Array, list[str], list[str]]:
    """Records of the native and of the Python unit, and what they logged."""
    records, notes = [], []
    for folder in (native_folder(unit, structure, basis), workshop.folder(unit, structure, basis)):
        with loaded(folder) as instance:
            instance.begin(**starts)
            records.append(record(instance, steps, step, excitation(unit, structure)))
            notes.append(list(instance.notes))
    return records[0], records[1], notes[0], notes[1]


@pytest.mark.parametrize("unit", UNITS)
def test_defaults_equal_the_python_unit(workshop: Workshop, unit: str) -> None:
    native, python, said, expected = both(workshop, unit, 2000)
    assert difference(native, python) < 1e-12
    assert said == expected


@pytest.mark.parametrize(("structure", "basis"), [(s, b) for s in STRUCTURES for b in ("clamped_free", "segment")])
@pytest.mark.parametrize("unit", UNITS)
def test_any_structure_and_basis(workshop: Workshop, unit: str, structure: str, basis: str) -> None:
    """Another design, so all tables differ. Early in a transition of five beams, the feedforward's sums of 31
    derivatives cancel to a hundred-thousandth of their terms. The exact plant of five beams has the largest
    eigenproblem, which the two kernels solve by different methods."""
    native, python, *_ = both(workshop, unit, 150, structure=structure, basis=basis)
    exact_chain = (unit, structure, basis) == ("BeamPlant", "five_beams", "segment")
    limit = 1e-10 if unit == "FlatnessFeedforward" else 5e-12 if exact_chain else 1e-12
    assert difference(native, python) < limit


@pytest.mark.parametrize("basis", ["clamped_free", "segment"])
def test_changed_parameters(workshop: Workshop, basis: str) -> None:
    """Several of the 37 at once, some of which vanish; strains with noise; at rest under voltages at first."""
    changed = {
        "beam[1].density": 1800.0,
        "beam[2].youngs_modulus": 4e10,
        "beam[3].tip_mass": 0.0,
        "beam[1].viscous_damping": 0.5,
        "beam[2].structural_damping": 0.0,
        "patch[3].piezo_ratio": 30.0,
        "patch[1].density": 4000.0,
        "spring[1].stiffness": 11.0,
        "strain_noise_std": 1e-6,
        "noise_seed": 7,
        "start_at_rest_under": [300.0, -120.0, 0.0, 50.0],
    }
    native, python, *_ = both(workshop, "BeamPlant", 1000, basis=basis, **changed)
    default, *_ = both(workshop, "BeamPlant", 1, basis=basis)
    assert difference(native, python) < 1e-10
    assert difference(native[:2, 8:12], default[:, 8:12]) > 0.1


@pytest.mark.parametrize(
    "name",
    [
        "beam[1].density",
        "beam[3].youngs_modulus",
        "beam[2].tip_mass",
        "beam[1].viscous_damping",
        "beam[2].structural_damping",
        "patch[4].density",
        "patch[2].youngs_modulus",
        "patch[1].viscous_damping",
        "patch[3].structural_damping",
        "patch[4].piezo_ratio",
        "spring[2].stiffness",
    ],
)
def test_every_kind_of_parameter(workshop: Workshop, name: str) -> None:
    value = 1.3 * design_of().structure.parameters()[name]
    native, python, *_ = both(workshop, "BeamPlant", 200, **{name: value})
    assert difference(native, python) < 1e-10


@pytest.mark.parametrize("step", [7e-5, 1e-3, 1.3e-2])
@pytest.mark.parametrize("unit", UNITS)
def test_other_communication_steps(workshop: Workshop, unit: str, step: float) -> None:
    native, python, *_ = both(workshop, unit, 300, step)
    assert difference(native, python) < 1e-10


def test_rounding_of_a_target_starts_no_transition(workshop: Workshop) -> None:
    for folder in (native_folder("FlatnessFeedforward"), workshop.folder("FlatnessFeedforward")):
        with loaded(folder) as unit:
            unit.begin()
            unit.advance(0.1, y_target=[5e-14, 0.0, -5e-13, 0.0])
            assert unit.take("moving")[0] == 0
            unit.advance(0.1, y_target=[5e-12, 0.0, 0.0, 0.0])
            assert unit.take("moving")[0] == 1


def test_way_back_after_the_limit_was_lowered(workshop: Workshop) -> None:
    """Both kernels let the motion return from voltages beyond a limit that was lowered meanwhile."""
    inverse = design_of().arrays["static_inverse"]
    target = np.linalg.pinv(inverse) @ np.array([800.0, -700.0, -800.0, 750.0])
    traces = []
    for folder in (native_folder("FlatnessFeedforward"), workshop.folder("FlatnessFeedforward")):
        with loaded(folder) as unit:
            unit.begin()
            unit.advance(1.0, y_target=target)
            unit.advance(0.5)
            assert np.max(np.abs(unit.take("u_ff"))) == pytest.approx(800)
            unit.advance(0.1, voltage_limit=300.0, y_target=0.1 * target)
            assert unit.take("target_refused")[0] == 0
            rows = []
            for _ in range(100):
                unit.advance(0.01)
                rows.append(unit.take("u_ff", "x_ref", "planned_peak", "planned_time"))
            traces.append(np.array(rows))
    assert np.max(np.abs(traces[0][-1, :4])) == pytest.approx(80)
    assert difference(*traces) < 1e-12


@pytest.mark.parametrize(
    ("starts", "word"),
    [({"voltage_limit": 150.0}, "refused"), ({"transition_time": 0.2, "voltage_limit": 450.0}, "stretched")],
)
def test_plans_equal_the_python_unit(workshop: Workshop, starts: dict[str, float], word: str) -> None:
    """The limit refuses a target or stretches a transition: same plans, same lines in the log."""
    native, python, said, expected = both(workshop, "FlatnessFeedforward", 2000, preview=4e-4, **starts)
    assert any(word in line for line in said)
    assert said == expected
    assert difference(native, python) < 1e-12


def test_closed_loop(workshop: Workshop) -> None:
    """Plant, feedforward and controller exchange values after each of 4000 steps."""
    target = np.linalg.pinv(design_of().arrays["static_inverse"]) @ [300.0, -100.0, 200.0, 150.0]
    records = []
    for folder_of in (native_folder, workshop.folder):
        with ExitStack() as stack:
            plant, feedforward, controller = (
                stack.enter_context(loaded(folder_of(unit))).begin()
                for unit in ("BeamPlant", "FlatnessFeedforward", "TrackingController")
            )
            rows = []
            for k in range(4000):
                if k == 50:
                    feedforward.put("y_target", target)
                if k == 2500:
                    feedforward.put("y_target", -target)
                plant.put("force", [0.0, 0.2 if 3000 <= k < 3050 else 0.0, 0.0])
                for unit in (plant, feedforward, controller):
                    unit.advance(SAMPLE)
                rows.append(np.concatenate([plant.take("y_pi", "y_pm"), controller.take("u", "y_est", "x_est")]))
                controller.put("y_pm", plant.take("y_pm"))
                controller.put("u_ff", feedforward.take("u_ff"))
                controller.put("x_ref", feedforward.take("x_ref"))
                plant.put("u", controller.take("u"))
            records.append(np.array(rows))
    assert np.max(np.abs(records[1][:, 0])) > 1e-3
    assert difference(*records) < 1e-9


def slopes(unit: Loaded, name: str, values: Array) -> None:
    """Sets first derivatives of an input array for the next step."""
    references = [v.valueReference for n, v in unit.variables.items() if n.startswith(f"{name}[")]
    unit.call("setRealInputDerivatives", references, [1] * len(references), list(values))


SLOPE = np.array([9000.0, -4000.0, 2500.0, 6000.0])  # V/s


def after_ramp(parts: int, basis: str, held: bool = False) -> Array:
    """The plant's outputs after voltages grew linearly for 0.02 s, in equal steps; or held at each step's middle."""
    step = 0.02 / parts
    with loaded(native_folder("BeamPlant", basis=basis)) as plant:
        plant.begin()
        for k in range(parts):
            plant.put("u", SLOPE * step * (k + 0.5 if held else k))
            if not held:
                slopes(plant, "u", SLOPE)
            plant.advance(step)
        return plant.take("y_pi", "y_pm")


@pytest.mark.parametrize("basis", ["clamped_free", "segment"])
def test_interpolated_inputs_are_exact(basis: str) -> None:
    """One step under a ramp equals many short ones."""
    exact = after_ramp(1, basis)
    assert np.max(np.abs(after_ramp(40, basis) - exact)) < 1e-10 * np.max(np.abs(exact))


def test_held_inputs_approach_interpolated_ones() -> None:
    """With second order, where the middle of each step is held."""
    exact = after_ramp(1, "clamped_free")[:4]
    errors = [np.max(np.abs(after_ramp(parts, "clamped_free", held=True)[:4] - exact)) for parts in (40, 80)]
    assert errors[1] < 1e-3 * np.max(np.abs(exact))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def test_input_derivatives_hold_for_one_step() -> None:
    """They are part of the state until then; afterwards the input is what was set."""
    with loaded(native_folder("BeamPlant")) as plant, loaded(native_folder("BeamPlant")) as other:
        plant.begin().put("u", [100.0, 0.0, 0.0, 0.0])
        slopes(plant, "u", SLOPE)
        other.prepare().restore(plant.saved())
        outputs = [unit.advance(1e-3).take("y_pi", "y_pm") for unit in (plant, other)]
        assert (outputs[0] == outputs[1]).all()
        slopes(other, "u", 0 * SLOPE)
        outputs = [unit.advance(1e-3).take("y_pi", "y_pm") for unit in (plant, other)]
        assert (outputs[0] == outputs[1]).all()
        assert (plant.take("u") == [100.0, 0.0, 0.0, 0.0]).all()


def test_inputs_without_a_derivative_of_this_step_do_not_grow() -> None:
    """Whatever derivatives a step before had, or one that a reset has taken back."""
    with loaded(native_folder("BeamPlant")) as plant, loaded(native_folder("BeamPlant")) as other:
        for unit in (plant.begin(), other.begin()):
            slopes(unit, "u", SLOPE)
            unit.advance(1e-3)
            slopes(unit, "force", [0.0, 2.0, -3.0])
        slopes(other, "u", 0 * SLOPE)
        np.testing.assert_array_equal(plant.advance(1e-3).everything(), other.advance(1e-3).everything())
        slopes(plant, "u", SLOPE)
        for unit in (plant, other):
            unit.call("reset")
            slopes(unit.begin(), "force", [0.0, 2.0, -3.0])
        slopes(other, "u", 0 * SLOPE)
        np.testing.assert_array_equal(plant.advance(1e-3).everything(), other.advance(1e-3).everything())


def test_steps_that_differ_by_the_rounding_of_the_clock() -> None:
    """A host that subtracts times asks for steps that differ in the last digits; they are one step."""
    ends = []
    for jitter in (0.0, 1e-16):
        with loaded(native_folder("BeamPlant")) as plant:
            plant.begin().put("u", 500.0)
            for k in range(2000):
                plant.advance(SAMPLE + jitter * (k % 5 - 2))
            ends.append(plant.take("y_pi", "y_pm"))
    assert np.max(np.abs(ends[1] - ends[0])) < 1e-9 * np.max(np.abs(ends[0]))


@pytest.mark.parametrize("unit", [unit for unit in UNITS if unit != "MfcCompensator"])
def test_a_split_step_gives_the_same(unit: str) -> None:
    """Samples one by one or ten at once, inputs held meanwhile; the feedforward plans at the first of them.

    The compensator's command is for a next step of the same size.
    """
    ends = []
    for parts in (1, 10):
        with loaded(native_folder(unit)) as instance:
            instance.begin()
            for k in range(50):
                excitation(unit)(instance, 50 * k)
                for _ in range(parts):
                    instance.advance(10 * SAMPLE / parts)
            ends.append(instance.everything())
    assert np.max(np.abs(ends[1] - ends[0])) < 1e-9 * np.max(np.abs(ends[0]))
