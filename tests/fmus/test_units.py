"""The three units through FMPy: what they declare, and what all of them must do alike."""

import re
import zipfile
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.validation import validate_fmu

from flexbeams.fmus.units.catalogue import CATALOGUE
from flexbeams.scenarios.simulation.failure import UnitFailure
from tests.helpers import STRUCTURES, UNITS, Workshop, design_of
from tests.units.loaded import Loaded, Real, loaded

BASES = ("clamped_free", "segment")
SAMPLE = 2e-4
# Inputs that set a unit moving from rest at zero; a controller is driven into its limit at first
WORK: dict[str, dict[str, float]] = {
    "BeamPlant": {"u": 700.0, "force": 0.03},
    "FlatnessFeedforward": {"y_target": -1.5e-3},
    "TrackingController": {"y_pm": 3e-4, "u_ff": 990.0, "x_ref": 0.2},
    "MfcActuator": {"u": 990.0},
    "MfcCompensator": {"u_eff": 990.0},
}


@pytest.mark.parametrize(("structure", "unit"), list(product(STRUCTURES, UNITS)))
def test_fmpy_has_no_complaint(workshop: Workshop, structure: str, unit: str) -> None:
    """FMPy takes seconds for the plant's many names; the other basis differs in no name and in no rule but limits."""
    first, second = (workshop.fmu(unit, structure, basis) for basis in BASES)
    assert validate_fmu(str(first)) == []
    texts = [(workshop.folder(unit, structure, basis) / "modelDescription.xml").read_text() for basis in BASES]
    named = [re.sub(r'(guid|start|max)="[^"]*"|model of \d+ states', "", text) for text in texts]
    assert named[0] == named[1]
    assert texts[0] != texts[1]
    entries = [sorted(name.rpartition(".")[2] for name in zipfile.ZipFile(file).namelist()) for file in (first, second)]
    assert entries[0] == entries[1]


@pytest.mark.parametrize(("structure", "unit"), list(product(STRUCTURES, UNITS)))
def test_start_values_in_the_description_are_the_kernels(workshop: Workshop, structure: str, unit: str) -> None:
    with loaded(workshop.folder(unit, structure)) as instance:
        declared = {n: start_value(v) for n, v in instance.variables.items() if v.start is not None}
        assert {n: instance.get(n) for n in declared} == declared
        instance.begin()
        assert {n: instance.get(n) for n in declared} == declared


def start_value(variable: Any) -> float | bool | str:
    """The start value in the description by its type."""
    if variable.type == "Boolean":
        return bool({"true": True, "false": False}.get(variable.start, variable.start))
    return str(variable.start) if variable.type == "String" else float(variable.start)


@pytest.mark.parametrize(("structure", "basis"), list(product(STRUCTURES, BASES)))
def test_variables_of_the_units(workshop: Workshop, structure: str, basis: str) -> None:
    """The table of the units, for any number of beams; indices from 1, every variable described, units of SI."""
    design = design_of(structure, basis)
    parts = design.structure
    r, n_u, n_pi, n_pm = len(parts.beam), len(parts.patch), len(parts.point_of_interest), len(parts.strain_gauge)
    m = 10 * r
    operators = {"play_threshold": 7, "play_weight": 7, "dead_zone_threshold": 2, "dead_zone_slope": 2}
    operators |= {"creep_time": 6, "creep_weight": 6, "history": 4}
    patches = {name: n * n_u for name, n in operators.items()}
    patches |= dict.fromkeys(("linear_weight", "face_minimum", "face_maximum", "supply"), n_u)
    expected: dict[str, dict[str, dict[str, int]]] = {
        "BeamPlant": {
            "input": {"u": n_u, "force": r},
            "output": {"y_pi": n_pi, "y_pm": n_pm},
            "local": {"w": 21 * r, "energy": 1, "design_id": 1},
        },
        "FlatnessFeedforward": {
            "input": {"y_target": n_pi},
            "output": {"u_ff": n_u, "x_ref": m, "y_ref": n_pi, "moving": 1},
            "parameter": {
                "transition_time": 1,
                "voltage_limit": 1,
                "voltage_min": n_u,
                "voltage_max": n_u,
                "preview": 1,
            },
        },
        "TrackingController": {
            "input": {"y_pm": n_pm, "u_ff": n_u, "x_ref": m},
            "output": {"u": n_u, "y_est": n_pi, "saturated": 1},
            "parameter": {
                "feedback": 1,
                "integral_gain": 1,
                "voltage_limit": 1,
                "voltage_min": n_u,
                "voltage_max": n_u,
                "strain_limit": 1,
                "rejected_limit": 1,
            },
        },
        "MfcActuator": {
            "input": {"u": n_u},
            "output": {"u_eff": n_u, "saturated": 1},
            "local": {"voltage": n_u, "saturated_steps": 1, "design_id": 1},
            "parameter": {**patches, "lag": n_u, "slew_rate": n_u, "resolution": n_u},
        },
        "MfcCompensator": {
            "input": {"u_eff": n_u},
            "output": {"u": n_u, "saturated": 1},
            "local": {"saturated_steps": 1, "design_id": 1},
            "parameter": patches,
        },
    }
    for unit, kinds in expected.items():
        description = read_model_description(workshop.fmu(unit, structure, basis), validate=False)
        assert (description.modelName, description.fmiVersion) == (unit, "2.0")
        assert description.variableNamingConvention == "structured"
        assert float(description.defaultExperiment.stepSize) == SAMPLE
        variables = description.modelVariables
        for causality, arrays in kinds.items():
            found: dict[str, int] = {}
            for v in variables:
                if v.causality == causality:
                    found[v.name.partition("[")[0]] = found.get(v.name.partition("[")[0], 0) + 1
            assert found.items() >= arrays.items()
            assert causality == "local" or found == arrays
        assert all(v.description for v in variables)
        assert all(v.unit for v in variables if v.type == "Real")
        units = {v.name.partition("[")[0]: v.unit for v in variables}
        assert units == units | {
            name: unit
            for name, unit in {"u": "V", "force": "N", "y_pi": "m", "y_pm": "1", "u_ff": "V", "y_target": "m"}.items()
            if name in units
        }
        assert description.modelVariables[-1].name == "design_id"
        assert description.modelVariables[-1].start == design.design_id


def test_the_37_parameters_of_the_paper(workshop: Workshop) -> None:
    variables = read_model_description(workshop.fmu("BeamPlant"), validate=False).modelVariables
    physical = [v.name for v in variables if v.causality == "parameter" and "]." in v.name]
    assert sorted(physical) == sorted(design_of().structure.parameters())
    assert len(physical) == 37
    with loaded(workshop.folder("BeamPlant")) as plant:
        plant.prepare()
        for k, name in enumerate(physical):
            plant.put(name, float(plant.get(name)) * (1.01 + 0.001 * k))
        plant.call("exitInitializationMode")
        for k, name in enumerate(physical):
            assert plant.get(name) == float(plant.variables[name].start) * (1.01 + 0.001 * k)


def test_description_is_that_of_the_interface(workshop: Workshop) -> None:
    """The file that ships has the variables of the one declaration, value references in its order."""
    design = design_of()
    for kind in CATALOGUE:
        declared = kind.declare(design, design.model()).variables
        read = read_model_description(workshop.fmu(kind.name), validate=False).modelVariables
        assert [(v.name, v.causality, v.unit) for v in read] == [(v.name, v.causality, v.unit) for v in declared]
        assert [v.valueReference for v in read] == list(range(len(read)))


@pytest.mark.parametrize("unit", UNITS)
def test_initial_values_depend_on_what_is_declared(workshop: Workshop, unit: str) -> None:
    """Each input and parameter is moved in initialization mode: only outputs that name it may change."""
    description = read_model_description(workshop.fmu(unit), validate=False)
    assert all(unknown.dependencies == [] for unknown in description.outputs)
    assert [u.variable.name for u in description.outputs] == [u.variable.name for u in description.initialUnknowns]
    declared = {u.variable.name: {d.name for d in u.dependencies} for u in description.initialUnknowns}
    base: dict[str, float] = {"start_at_rest_under": 500.0, "strain_noise_std": 1e-6} if unit == "BeamPlant" else {}
    base |= {"y_target": -1e-3} if unit == "FlatnessFeedforward" else {}
    seen: set[str] = set()
    with loaded(workshop.folder(unit)) as instance:
        instance.prepare(**base)
        before = {name: instance.get(name) for name in declared}
        for v in description.modelVariables:
            if v.causality not in ("input", "parameter") or v.type == "String":
                continue
            old = instance.get(v.name)
            moved = not old if v.type == "Boolean" else old * 1.01 + (1.0 if v.type == "Integer" else 1e-6)
            instance.set_start(v.name, min(moved, float(v.max)) if v.max else moved)
            changed = {name for name in declared if instance.get(name) != before[name]}
            assert all(v.name in declared[name] for name in changed), v.name
            seen |= {v.name} if changed else set()
            instance.set_start(v.name, old)
        assert {name: instance.get(name) for name in declared} == before
    needed = {
        "BeamPlant": {"start_at_rest_under[2]", "spring[1].stiffness", "noise_seed"},
        "FlatnessFeedforward": {"y_target[3]"},
        "TrackingController": {"x_ref[1]", "u_ff[4]"},
        "MfcActuator": {"history[1,4]"},
        "MfcCompensator": {"history[1,4]"},
    }
    assert seen >= needed[unit]


def moved(instance: Loaded, steps: int, step: float = SAMPLE) -> Real:
    """Values after each of some steps in which every input changes."""
    trace = []
    for _ in range(steps):
        k = round(instance.now / step)
        inputs = {
            name: value * (1 + 0.1 * (k % 7)) * (-1) ** (k // 40)
            for name, value in WORK[instance.description.modelName].items()
        }
        if "y_target" in inputs:  # a new target, and so a new transition, every 80 steps
            inputs = {"y_target": inputs["y_target"] * (k // 80)} if k % 80 == 3 else {}
        trace.append(instance.advance(step, **inputs).everything())
    return np.array(trace)


@pytest.mark.parametrize("unit", UNITS)
def test_two_instances_do_not_touch(workshop: Workshop, unit: str) -> None:
    folder = workshop.folder(unit)
    with loaded(folder) as alone:
        expected = moved(alone.begin(), 120)
    assert np.ptp(expected, axis=0).max() > 0
    with loaded(folder, "first") as first, loaded(folder, "second") as second:
        first.begin()
        early = [moved(first, 1)[0] for _ in range(60)]
        second.begin()
        pairs = [(moved(first, 1)[0], moved(second, 1)[0]) for _ in range(60)]
    np.testing.assert_array_equal([*early, *(one for one, _ in pairs)], expected)
    np.testing.assert_array_equal([other for _, other in pairs], expected[:60])


@pytest.mark.parametrize("unit", UNITS)
def test_instances_of_three_designs_in_one_process(workshop: Workshop, unit: str) -> None:
    """Units of different structures have modules of different names, so none runs another's code or data."""
    alone = {}
    for structure in STRUCTURES:
        with loaded(workshop.folder(unit, structure)) as instance:
            alone[structure] = moved(instance.begin(), 40)
    with (
        loaded(workshop.folder(unit, STRUCTURES[0])) as a,
        loaded(workshop.folder(unit, STRUCTURES[1])) as b,
        loaded(workshop.folder(unit, STRUCTURES[2])) as c,
    ):
        instances = dict(zip(STRUCTURES, (a, b, c), strict=True))
        traces: dict[str, list[Real]] = {name: [] for name in STRUCTURES}
        for instance in instances.values():
            instance.begin()
        for _ in range(40):
            for name, instance in instances.items():
                traces[name].append(moved(instance, 1)[0])
    for name in STRUCTURES:
        np.testing.assert_array_equal(traces[name], alone[name])


@pytest.mark.parametrize("unit", UNITS)
def test_reset_is_as_good_as_new(workshop: Workshop, unit: str) -> None:
    with loaded(workshop.folder(unit)) as instance:
        fresh = instance.everything()
        expected = moved(instance.begin(), 60)
        instance.call("reset")
        np.testing.assert_array_equal(instance.everything(), fresh)
        np.testing.assert_array_equal(moved(instance.begin(), 60), expected)


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("at", [0, 1, 37, 150])
def test_saved_state_continues_bit_for_bit(workshop: Workshop, unit: str, at: int) -> None:
    """In mid-run: the feedforward between two transitions that overlap, the controller at its limit."""
    folder = workshop.folder(unit)
    with loaded(folder) as first, loaded(folder, "other") as second:
        moved(first.begin(), at)
        if at == 150:
            assert unit == "BeamPlant" or first.take({"FlatnessFeedforward": "moving"}.get(unit, "saturated"))[0] == 1
        state = first.saved()
        expected = moved(first, 130)
        again = moved(first.restore(state), 130)
        np.testing.assert_array_equal(again, expected)
        assert first.restore(state).saved() == state
        moved(second.begin(), 23)
        np.testing.assert_array_equal(moved(second.restore(state), 130), expected)


def test_state_keeps_parameters_that_were_set(workshop: Workshop) -> None:
    """A restored plant has the saved one's matrices, not its own."""
    folder = workshop.folder("BeamPlant")
    with loaded(folder) as first, loaded(folder) as second:
        first.begin(**{"spring[2].stiffness": 50.0, "beam[1].tip_mass": 0.0})
        moved(first, 10)
        state, expected = first.saved(), moved(first, 30)
        moved(second.begin(), 5)
        np.testing.assert_array_equal(moved(second.restore(state), 30), expected)


@pytest.mark.parametrize("unit", UNITS)
def test_state_of_another_design_is_refused(workshop: Workshop, unit: str) -> None:
    with loaded(workshop.folder(unit)) as own, loaded(workshop.folder(unit, basis="segment")) as foreign:
        state = moved(own.begin(), 5).size and own.saved()
        foreign.begin()
        before = foreign.everything()
        with pytest.raises(UnitFailure, match="must be of the same unit and design, got that of another"):
            foreign.restore(state)
        np.testing.assert_array_equal(foreign.everything(), before)


def test_state_of_another_unit_is_refused(workshop: Workshop) -> None:
    with loaded(workshop.folder("BeamPlant")) as plant, loaded(workshop.folder("TrackingController")) as controller:
        state = plant.begin().saved()
        with pytest.raises(UnitFailure, match="must be of the same unit and design"):
            controller.begin().restore(state)


@pytest.mark.parametrize("unit", UNITS)
def test_start_at_another_time(workshop: Workshop, unit: str) -> None:
    """A run from t = 100 s is the run from 0, later; ticks and transitions count from the start."""
    with loaded(workshop.folder(unit)) as early, loaded(workshop.folder(unit)) as late:
        early.begin()
        late.begin(100.0)
        for k in range(150):
            inputs = WORK[unit] if k in (2, 70) else {}
            inputs = {name: value * (1 + k) / 71 for name, value in inputs.items()}
            a, b = early.advance(SAMPLE, **inputs).everything(), late.advance(SAMPLE, **inputs).everything()
            np.testing.assert_allclose(b[1:], a[1:], rtol=1e-7, atol=1e-9 * np.abs(a[1:]).max())


@pytest.mark.parametrize(
    ("unit", "name", "value", "rule"),
    [
        ("BeamPlant", "u[2]", np.nan, "u[2] must be finite, got nan"),
        ("BeamPlant", "force[3]", np.inf, "force[3] must be finite, got inf"),
        ("BeamPlant", "strain_noise_std", -1e-6, "strain_noise_std must be >= 0.0, got -1e-06"),
        ("BeamPlant", "noise_seed", -1, "noise_seed must be >= 0, got -1"),
        ("FlatnessFeedforward", "y_target[4]", -np.inf, "y_target[4] must be finite, got -inf"),
        ("FlatnessFeedforward", "transition_time", 0.0, "transition_time must be >= 0.001, got 0.0"),
        ("FlatnessFeedforward", "preview", -1.0, "preview must be >= 0.0, got -1.0"),
        ("FlatnessFeedforward", "voltage_limit", -1.0, "voltage_limit must be >= 0.0, got -1.0"),
        ("FlatnessFeedforward", "voltage_min[2]", 1e-9, "voltage_min[2] must be <= 0.0, got 1e-09"),
        ("FlatnessFeedforward", "voltage_max[3]", -200.0, "voltage_max[3] must be >= 0.0, got -200.0"),
        ("FlatnessFeedforward", "voltage_max[3]", np.nan, "voltage_max[3] must be finite, got nan"),
        ("TrackingController", "y_pm[6]", np.nan, "y_pm[6] must be finite, got nan"),
        ("TrackingController", "integral_gain", 1.5, "integral_gain must be <= 0.0012, got 1.5"),
        ("TrackingController", "voltage_limit", -5.0, "voltage_limit must be >= 0.0, got -5.0"),
        ("TrackingController", "u[1]", 1.0, "u[1] is output and cannot be set, got 1.0"),
    ],
)
def test_bad_values_are_refused_by_name(workshop: Workshop, unit: str, name: str, value: float, rule: str) -> None:
    with loaded(workshop.folder(unit)) as instance:
        instance.prepare()
        with pytest.raises(UnitFailure) as failure:
            instance.put(name, value)
        assert rule in str(failure.value)


def test_fmu_files_are_reproducible(workshop: Workshop, tmp_path: Path) -> None:
    """The same design gives the same bytes."""
    from flexbeams.fmus.packaging.build import build_units

    design = design_of("single_beam")
    again: list[Any] = build_units(CATALOGUE, design, design.model(), tmp_path, backend="python")
    for path in again:
        assert path.read_bytes() == workshop.fmu(path.stem, "single_beam").read_bytes()
