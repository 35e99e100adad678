"""Contents that no instance can have saved are refused by both kernels; a read that fails does no harm."""

import struct
import zlib

import numpy as np
import pytest

from flexbeams.controller.planner import PLANNING_TICKS
from flexbeams.fmus.python.snapshot import pack_state, unpack_state
from flexbeams.scenarios.simulation.failure import UnitFailure
from tests.helpers import UNITS, BuiltUnits, Workshop
from tests.native.workshop import native_folder, needs_zig
from tests.units.loaded import Loaded, loaded

SAMPLE = 2e-4
RULE = "FMU state must have contents that this unit can have saved"
# Arrays of a saved Python state: clock, values, then those of the kernel in the order of its setup, then texts
PARTS = {"BeamPlant": 4, "FlatnessFeedforward": 12, "TrackingController": 9, "MfcActuator": 5, "MfcCompensator": 5}
HEADER = 384  # bytes before the values in a native state
CLOCK, VALUES = 0, 1
INTEGRAL, TICK, IN_A_ROW, LOWEST, HIGHEST, SATURATED = 2, 3, 4, 5, 6, 7  # of the controller
COUNT, TICK_OF_TARGETS, DUE, STARTS, DURATIONS = 2, 3, 4, 7, 8  # of the feedforward


def forged(state: bytes, unit: str, part: int, index: int, value: float, kind: str = "d") -> bytes:
    """A saved Python state with another number and a checksum that fits."""
    phase, parts = unpack_state(state, state[24:56], PARTS[unit])
    changed = bytearray(parts[part])
    struct.pack_into(f"<{kind}", changed, 8 * index, value)
    parts[part] = bytes(changed)
    return pack_state(state[24:56], phase, parts)


def forged_doubles(state: bytes, at: int, *values: float) -> bytes:
    """A saved native state with other doubles from a byte on and a checksum that fits."""
    changed = bytearray(state)
    struct.pack_into(f"<{len(values)}d", changed, at, *values)
    struct.pack_into("<I", changed, 12, zlib.crc32(bytes(changed[16:])))
    return bytes(changed)


CASES = [
    ("TrackingController", TICK, 0, 10**15, "q"),
    ("TrackingController", TICK, 0, -5, "q"),
    ("TrackingController", IN_A_ROW, 2, 0.5, "d"),
    ("TrackingController", IN_A_ROW, 2, -1.0, "d"),
    ("TrackingController", IN_A_ROW, 2, 1e300, "d"),
    ("TrackingController", LOWEST, 1, 1e-300, "d"),
    ("TrackingController", LOWEST, 3, -np.inf, "d"),
    ("TrackingController", HIGHEST, 0, -1e-300, "d"),
    ("TrackingController", HIGHEST, 2, np.nan, "d"),
    ("TrackingController", SATURATED, 0, 2.0, "d"),
    ("TrackingController", SATURATED, 0, 0.5, "d"),
    ("TrackingController", INTEGRAL, 1, np.nan, "d"),
    ("TrackingController", VALUES, 7, 1e9, "d"),  # u_ff[1]
    ("TrackingController", VALUES, 7, np.nan, "d"),
    ("FlatnessFeedforward", COUNT, 0, 9, "q"),
    ("FlatnessFeedforward", COUNT, 0, -1, "q"),
    ("FlatnessFeedforward", TICK_OF_TARGETS, 0, 10**15, "q"),
    ("FlatnessFeedforward", DUE, 0, 1 + PLANNING_TICKS + 1, "q"),
    ("FlatnessFeedforward", DUE, 0, 0, "q"),
    ("FlatnessFeedforward", DURATIONS, 0, 0.0, "d"),
    ("FlatnessFeedforward", DURATIONS, 0, 1e13, "d"),
    ("FlatnessFeedforward", STARTS, 0, np.inf, "d"),
    ("BeamPlant", CLOCK, 6, 0.5, "d"),  # steps
    ("BeamPlant", VALUES, 0, 7.0, "d"),  # time
]


@pytest.mark.parametrize(("unit", "part", "index", "value", "kind"), CASES)
def test_python_units_refuse_what_they_cannot_have_saved(
    workshop: Workshop, unit: str, part: int, index: int, value: float, kind: str
) -> None:
    """With one line; the instance works again with the state as it was."""
    with loaded(workshop.folder(unit)) as one:
        one.begin()
        if unit == "FlatnessFeedforward":
            one.put("y_target", 1e-4 * np.array([-8.0, 1.0, 4.0, -6.0]))
        good = one.advance(SAMPLE).saved()
        expected = one.advance(SAMPLE).everything()
        with pytest.raises(UnitFailure, match=RULE):
            one.restore(forged(good, unit, part, index, value, kind))
        assert one.restore(good).advance(SAMPLE).everything().tobytes() == expected.tobytes()


ABSURD = (-np.inf, -1e300, -1e6, -1.0, 0.0, 1e-300, 0.5, 1.0, 2.0, 1e6, 2.0**31, 1e300, np.nan)


def takes(one: Loaded, state: bytes) -> bool:
    """Whether a state is restored."""
    try:
        one.restore(state)
    except UnitFailure:
        return False
    return True


@needs_zig
@pytest.mark.parametrize("unit", UNITS)
def test_both_kernels_take_the_same_values_of_variables(workshop: Workshop, unit: str) -> None:
    """Of one variable or of one element of each array: what can be set within its bounds, Integers and Booleans."""
    with loaded(native_folder(unit)) as native, loaded(workshop.folder(unit)) as python:
        good, other = (one.begin().advance(SAMPLE).saved() for one in (native, python))
        numbers = {v.name.split("[")[0]: v for v in native.variables.values() if v.type != "String"}
        refused = 0
        for variable in numbers.values():
            place = variable.valueReference
            for value in ABSURD:
                taken = takes(native, forged_doubles(good, HEADER + 8 * place, value))
                assert takes(python, forged(other, unit, VALUES, place, value)) == taken, f"{variable.name} = {value}"
                possible = {"Real": True, "Integer": value.is_integer(), "Boolean": value in (0.0, 1.0)}
                assert possible[variable.type] or not taken
                refused += not taken
        assert refused > 5 * len(numbers)
        for one, state in ((native, good), (python, other)):
            one.restore(state).advance(SAMPLE)


def test_forging_itself_is_no_reason_to_refuse(workshop: Workshop) -> None:
    """The same numbers again, and others that are possible."""
    with loaded(workshop.folder("TrackingController")) as one:
        state = one.begin().advance(SAMPLE).saved()
        for part, index, value, kind in ((TICK, 0, 1, "q"), (IN_A_ROW, 2, 3.0, "d"), (HIGHEST, 0, 5.0, "d")):
            one.restore(forged(state, "TrackingController", part, index, value, kind)).advance(SAMPLE)


# Doubles from the end of a native state of the controller of kiel, after one tick
SATURATED, HIGHEST, LOWEST, REJECTED = -1, -5, -9, -15


@needs_zig
@pytest.mark.parametrize(
    ("place", "value"),
    [
        (SATURATED, 0.5),
        (SATURATED, -1.0),
        (SATURATED, 2.0),
        (HIGHEST, -1.0),
        (LOWEST, 1.0),
        (REJECTED, 0.5),
        (REJECTED, -1.0),
        (REJECTED, 1e300),
    ],
)
def test_native_counts_and_limits_are_possible_ones(place: int, value: float) -> None:
    with loaded(native_folder("TrackingController")) as one:
        one.begin().advance(SAMPLE)
        good = one.saved()
        before = struct.unpack_from("<d", good, len(good) + 8 * place)[0]
        assert before == {SATURATED: 0.0, HIGHEST: 1000.0, LOWEST: -1000.0, REJECTED: 0.0}[place]
        with pytest.raises(UnitFailure, match=RULE):
            one.restore(forged_doubles(good, len(good) + 8 * place, value))
        one.restore(good).advance(SAMPLE)


# Doubles of the native state of the feedforward of kiel; from START and DURATION on eight each, then the changes
NATIVE_COUNT, NATIVE_TICK, NATIVE_DUE, START, DURATION = 0, 1, 2, 11, 19


@needs_zig
@pytest.mark.parametrize(
    ("place", "value", "valid"),
    [
        (NATIVE_COUNT, 8.0, True),
        (NATIVE_COUNT, 9.0, False),
        (NATIVE_COUNT, 0.5, False),
        (NATIVE_COUNT, -1.0, False),
        (NATIVE_TICK, 3.0, True),
        (NATIVE_TICK, 4.0, False),
        (NATIVE_TICK, 1.5, False),
        (NATIVE_TICK, -2.0, False),
        (NATIVE_DUE, -2.0, False),
        (NATIVE_DUE, 0.0, False),
        (NATIVE_DUE, 1.0 + PLANNING_TICKS, True),
        (NATIVE_DUE, 2.0 + PLANNING_TICKS, False),
        (DURATION, 1e11, True),
        (DURATION, 1e12, False),
        (DURATION, 0.0, False),
        (DURATION + 7, -1.0, True),  # of no transition
        (START, np.inf, False),
    ],
)
def test_native_motions_are_possible_ones(place: int, value: float, valid: bool) -> None:
    """One transition is under way; the starts and durations behind it are those of seven others, and of an eighth."""
    with loaded(native_folder("FlatnessFeedforward")) as one:
        one.begin().put("y_target", 1e-4 * np.array([-8.0, 1.0, 4.0, -6.0]))
        good = one.advance(SAMPLE).saved()
        expected = one.advance(SAMPLE).everything()
        state = HEADER + 16 * len(one.variables)
        assert struct.unpack_from("<3d", good, state) == (1.0, 1.0, -1.0)
        assert struct.unpack_from("<9d", good, state + 8 * START) == (*[0.0] * 8, 0.9)
        filled = forged_doubles(good, state + 8 * (DURATION + 1), *[1.0] * 7)
        if place == NATIVE_COUNT:
            filled = forged_doubles(filled, state + 8 * (DURATION + 8), 1.0)  # what a ninth would take for its own
        changed = forged_doubles(filled, state + 8 * place, value)
        if valid:
            one.restore(changed).advance(SAMPLE)
        else:
            with pytest.raises(UnitFailure, match=RULE):
                one.restore(changed)
        np.testing.assert_array_equal(one.restore(good).advance(SAMPLE).everything(), expected)


def test_a_getter_that_cannot_be_computed_leaves_the_instance_going(units: BuiltUnits) -> None:
    """In initialization mode a target out of reach has no outputs; another target has, and steps follow."""
    target = -2e-3
    with loaded(units("FlatnessFeedforward")) as one:
        one.prepare(voltage_limit=12.5, y_target=target)
        for _ in range(2):
            with pytest.raises(UnitFailure, match="y_target is out of reach"):
                one.take("u_ff")
        one.put("voltage_limit", 800.0)
        one.put("y_target", target * np.array([3.2, -0.4, -1.6, 2.4]))
        assert one.take("u_ff").any()
        one.call("exitInitializationMode")
        expected = one.advance(SAMPLE).everything()
        with pytest.raises(UnitFailure, match="currentCommunicationPoint"):
            one.step(one.now + 1.0, SAMPLE)
        with pytest.raises(UnitFailure, match="fmi2DoStep is refused until fmi2Reset"):
            one.advance(SAMPLE)
    with loaded(units("FlatnessFeedforward")) as fresh:
        fresh.begin(voltage_limit=800.0, y_target=target * np.array([3.2, -0.4, -1.6, 2.4]))
        assert fresh.advance(SAMPLE).everything().tobytes() == expected.tobytes()


@pytest.mark.parametrize("unit", UNITS)
def test_a_state_of_a_failed_instance_has_failed(units: BuiltUnits, unit: str) -> None:
    """Wherever it goes on, until a reset; one from before the failure goes on."""
    with loaded(units(unit)) as one, loaded(units(unit)) as other:
        good = one.begin().saved()
        with pytest.raises(UnitFailure, match="currentCommunicationPoint"):
            one.step(5.0, SAMPLE)
        other.begin().restore(one.saved())
        rule = "fmi2DoStep is refused until .*, the instance failed: currentCommunicationPoint must be 0"
        with pytest.raises(UnitFailure, match=rule):
            other.advance(SAMPLE)
        expected = other.restore(good).advance(SAMPLE).everything()
        other.call("reset")
        np.testing.assert_array_equal(other.begin().advance(SAMPLE).everything(), expected)


def test_an_initialisation_that_cannot_be_computed_ends_the_instance(units: BuiltUnits) -> None:
    """Other values do not revive it; fmi2Reset does, as does a state from before, in which they can be set."""
    with loaded(units("FlatnessFeedforward")) as one:
        expected = one.begin(voltage_limit=800.0).advance(SAMPLE).everything()
        one.call("reset")
        one.prepare(voltage_limit=12.5, y_target=-2e-3)
        before = one.call("getFMUstate")
        with pytest.raises(UnitFailure, match="y_target is out of reach"):
            one.call("exitInitializationMode")
        one.put("y_target", 0.0)
        rule = "is refused until fmi2Reset or fmi2SetFMUstate, the instance failed: y_target is out of reach"
        with pytest.raises(UnitFailure, match=rule):
            one.call("exitInitializationMode")
        with pytest.raises(UnitFailure, match=rule):
            one.advance(SAMPLE)
        one.call("setFMUstate", before)
        one.call("freeFMUstate", before)
        one.put("y_target", 0.0)
        one.put("voltage_limit", 800.0)
        one.call("exitInitializationMode")
        assert one.advance(SAMPLE).everything().tobytes() == expected.tobytes()
        one.call("reset")
        assert one.begin(voltage_limit=800.0).advance(SAMPLE).everything().tobytes() == expected.tobytes()
