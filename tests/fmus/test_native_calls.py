"""Every call of FMI 2.0 on the native units: sequence, values, states, log; the same texts as the Python units."""

import struct
import zlib
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import closing
from ctypes import c_char_p, c_int, c_uint
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

from flexbeams.controller.planner import PLANNING_TICKS
from flexbeams.scenarios.masters.isolation import resident_bytes
from flexbeams.scenarios.simulation.failure import UnitFailure
from tests.helpers import UNITS, Workshop, design_of, resident
from tests.native.workshop import NATIVE_UNITS, native_folder
from tests.units.loaded import loaded

OK, WARNING, DISCARD, ERROR = range(4)
SAMPLE = 2e-4
pytestmark = pytest.mark.native


class Instance:
    """An instance whose calls return a status and the lines logged meanwhile instead of raising."""

    def __init__(self, folder: Path, name: str = "unit", logging: bool = True, guid: str | None = None) -> None:
        self.description = fmpy.read_model_description(folder)
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.lines: list[tuple[str, int, str, str]] = []
        self.fmu = FMU2Slave(
            guid=guid or self.description.guid,
            unzipDirectory=str(folder),
            instanceName=name,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
        )
        self._callbacks = fmi2CallbackFunctions()
        self._callbacks.logger = fmi2CallbackLoggerTYPE(self._log)  # no memory of the host: the unit takes its own
        self.fmu.instantiate(callbacks=self._callbacks, loggingOn=logging)

    def _log(self, _: Any, name: bytes, status: int, category: bytes, message: bytes) -> None:
        self.lines.append((name.decode(), status, category.decode(), message.decode()))

    def call(self, function: str, *arguments: Any) -> int:
        self.lines.clear()
        try:
            getattr(self.fmu, function)(*arguments)
        except FMICallException as error:
            return int(error.status)
        return OK

    def close(self) -> None:
        self.fmu.freeInstance()

    def to(self, phase: str) -> "Instance":
        calls = {
            "initialising": ("enterInitializationMode",),
            "stepping": ("exitInitializationMode",),
            "terminated": ("terminate",),
        }
        self.fmu.setupExperiment(startTime=0.0)
        for name, functions in calls.items():
            if phase == "instantiated":
                break
            for function in functions:
                getattr(self.fmu, function)()
            if name == phase:
                break
        return self


def instance(unit: str = "BeamPlant", **named: Any) -> "closing[Instance]":
    return closing(Instance(native_folder(unit), **named))


def after_a_step(one: Instance, phase: str = "") -> bytes:
    """Every number after a plain initialisation, or the rest of one, and a step in which nothing is logged."""
    if phase == "initialising":
        assert one.call("exitInitializationMode") == OK
    elif not phase:
        one.to("stepping")
    assert (one.call("doStep", 0.0, SAMPLE), one.lines) == (OK, [])
    kinds = {"Real": [], "Integer": [], "Boolean": []}  # type: dict[str, list[int]]
    for v in one.description.modelVariables:
        if v.type in kinds:
            kinds[v.type].append(v.valueReference)
    return np.concatenate([getattr(one.fmu, f"get{kind}")(found) for kind, found in kinds.items() if found]).tobytes()


@cache
def untouched(unit: str) -> bytes:
    """The same of an instance to which nothing else was done."""
    with instance(unit) as one:
        return after_a_step(one)


P, F, C = UNITS[:3]
# unit, phase, call, arguments, text: those of the base of the Python units
MISUSES: list[tuple[str, str, str, tuple[Any, ...], str]] = [
    (P, "stepping", "getReal", ([9999],), "value reference must be within 0..{last}, got 9999"),
    (P, "stepping", "setReal", ([2**32 - 1], [1.0]), "value reference must be within 0..{last}, got 4294967295"),
    (P, "stepping", "getReal", (["noise_seed"],), "noise_seed is Integer, got a call for Real"),
    (P, "stepping", "getBoolean", (["u[1]"],), "u[1] is Real, got a call for Boolean"),
    (C, "stepping", "getString", (["feedback"],), "feedback is Boolean, got a call for String"),
    (P, "initialising", "setInteger", (["design_id"], [1]), "design_id is String, got a call for Integer"),
    (P, "initialising", "setReal", (["y_pi[2]"], [1.0]), "y_pi[2] is output and cannot be set, got 1.0"),
    (P, "initialising", "setReal", (["w[2,3]"], [-0.25]), "w[2,3] is local and cannot be set, got -0.25"),
    (P, "stepping", "setReal", (["time"], [1e-7]), "time is independent and cannot be set, got 1e-07"),
    (P, "initialising", "setString", (["design_id"], ["x"]), "design_id is local and cannot be set, got 'x'"),
    (C, "stepping", "setBoolean", (["saturated"], [True]), "saturated is output and cannot be set, got True"),
    (
        P,
        "stepping",
        "setReal",
        (["beam[1].density"], [2e3]),
        "beam[1].density is fixed and cannot be set after initialisation, got 2000.0",
    ),
    (
        P,
        "stepping",
        "setInteger",
        (["noise_seed"], [3]),
        "noise_seed is fixed and cannot be set after initialisation, got 3",
    ),
    (P, "initialising", "setInteger", (["noise_seed"], [-3]), "noise_seed must be >= 0, got -3"),
    (P, "initialising", "setReal", (["beam[2].tip_mass"], [-0.5]), "beam[2].tip_mass must be >= 0.0, got -0.5"),
    (C, "stepping", "setReal", (["integral_gain"], [1.5]), "integral_gain must be <= 0.0012, got 1.5"),
    (F, "stepping", "setReal", (["transition_time"], [1e-4]), "transition_time must be >= 0.001, got 0.0001"),
    (P, "stepping", "setReal", (["u[2]"], [float("nan")]), "u[2] must be finite, got nan"),
    (P, "stepping", "setReal", (["u[3]", "u[2]"], [5.0, float("nan")]), "u[2] must be finite, got nan"),
    (
        C,
        "initialising",
        "setReal",
        (["u_ff[1]", "integral_gain"], [5.0, 1.5]),
        "integral_gain must be <= 0.0012, got 1.5",
    ),
    (P, "initialising", "setReal", (["force[3]"], [float("-inf")]), "force[3] must be finite, got -inf"),
    (P, "stepping", "doStep", (0.0, 0.0), "communicationStepSize must be finite and > 0, got 0.0"),
    (P, "stepping", "doStep", (0.0, -0.1), "communicationStepSize must be finite and > 0, got -0.1"),
    (C, "stepping", "doStep", (0.0, float("inf")), "communicationStepSize must be finite and > 0, got inf"),
    (C, "stepping", "doStep", (0.0, 1e9), "communicationStepSize must be <= 200.0, got 1000000000.0"),
    (F, "stepping", "doStep", (0.5, 0.1), "currentCommunicationPoint must be 0.0, the end of the last step, got 0.5"),
    (
        F,
        "stepping",
        "doStep",
        (float("nan"), 0.1),
        "currentCommunicationPoint must be 0.0, the end of the last step, got nan",
    ),
    (
        P,
        "initialising",
        "doStep",
        (0.0, 0.1),
        "fmi2DoStep needs an instance initialised, this one is in initialization mode",
    ),
    (
        P,
        "stepping",
        "setupExperiment",
        (),
        "fmi2SetupExperiment needs an instance just instantiated, this one is initialised",
    ),
    (
        P,
        "instantiated",
        "exitInitializationMode",
        (),
        "fmi2ExitInitializationMode needs an instance in initialization mode, this one is just instantiated",
    ),
    (P, "terminated", "terminate", (), "fmi2Terminate needs an instance initialised, this one is terminated"),
    (C, "terminated", "setReal", (["u_ff[1]"], [1.0]), "no variable can be set after fmi2Terminate"),
    (P, "instantiated", "setupExperiment", (None, float("nan")), "startTime must be finite, got nan"),
    (P, "instantiated", "setupExperiment", (None, 1.0, 1.0), "stopTime must be > startTime 1.0, got 1.0"),
]


@pytest.mark.parametrize(("unit", "phase", "function", "arguments", "text"), MISUSES, ids=[m[4][:60] for m in MISUSES])
def test_misuse_is_refused_with_one_line(
    unit: str, phase: str, function: str, arguments: tuple[Any, ...], text: str
) -> None:
    """fmi2Error, one line, nothing changed. Getters and setters do no harm, after others no step until fmi2Reset."""
    with instance(unit, name="beam 1") as one:
        one.to(phase)
        if arguments and isinstance(arguments[0], list):
            arguments = ([one.references.get(r, r) for r in arguments[0]], *arguments[1:])
        reals = [v.valueReference for v in one.description.modelVariables if v.type == "Real"]
        before = one.fmu.getReal(reals)
        assert one.call(function, *arguments) == ERROR
        reason = text.format(last=len(one.references) - 1)
        expected = reason if reason.startswith("fmi2") else f"fmi2{function[0].upper()}{function[1:]}: {reason}"
        assert one.lines == [("beam 1", ERROR, "logStatusError", expected)]
        assert one.fmu.getReal(reals) == before
        if function[3:] in ("Real", "Integer", "Boolean", "String") and phase != "terminated":
            assert after_a_step(one, phase) == untouched(unit)
        elif function[3:] != "Real":
            assert one.call("doStep", 0.0, SAMPLE) == ERROR
            assert one.lines[0][3] == (
                f"fmi2DoStep is refused until fmi2Reset or fmi2SetFMUstate, the instance failed: {reason}"
            )
        assert one.call("reset") == OK
        assert after_a_step(one) == untouched(unit)


@pytest.mark.parametrize(
    "case",
    [
        ("FlatnessFeedforward", {"y_target": 0.3}),
        ("FlatnessFeedforward", {"voltage_limit": 12.5, "y_target": -2e-3}),
    ],
)
def test_impossible_starts_are_refused_as_by_the_python_unit(
    workshop: Workshop, case: tuple[str, dict[str, float]]
) -> None:
    """At exitInitializationMode, naming what is wrong."""
    unit, values = case
    reasons = []
    for folder in (native_folder(unit), workshop.folder(unit)):
        with loaded(folder) as one, np.errstate(all="ignore"):
            one.prepare(**values)
            with pytest.raises(UnitFailure) as refusal:
                one.call("exitInitializationMode")
        reasons.append(str(refusal.value).replace("fmi2ExitInitializationMode: ", ""))
    assert reasons[0] == reasons[1]
    assert "exitInitializationMode" in reasons[0]


def test_after_an_impossible_parameter_the_unit_is_as_new() -> None:
    with instance() as one:
        expected = [after_a_step(one)]
    with instance() as one:
        one.to("initialising")
        assert one.call("setReal", [one.references["beam[1].density"]], [0.0]) == ERROR
        assert one.lines[0][3] == "fmi2SetReal: beam[1].density must be >= 1.0, got 0.0"
        one.call("reset")
        assert [after_a_step(one)] == expected


def test_as_many_references_as_variables_are_taken() -> None:
    """In any order and more than once; one more is refused."""
    with instance("TrackingController") as one:
        one.to("stepping")
        one.fmu.setReal([one.references["u_ff[2]"]], [7.0])
        pairs = [one.references["u_ff[2]"], one.references["u_ff[1]"]] * len(one.references)
        most = pairs[: len(one.references)]
        assert one.fmu.getReal(most) == [7.0 * (k % 2 == 0) for k in range(len(most))]
        assert one.call("setReal", most, [3.0] * len(most)) == OK
        assert one.call("getReal", pairs[: len(most) + 1]) == ERROR
        assert one.lines[0][3].endswith(f"nvr must be <= {len(most)}, the number of variables, got {len(most) + 1}")


def test_a_step_with_a_warning_is_a_warning_and_the_next_is_not() -> None:
    with instance("FlatnessFeedforward") as one:
        one.to("stepping")
        one.fmu.setReal([one.references[f"y_target[{k}]"] for k in range(1, 5)], [0.3] * 4)
        statuses = [one.fmu.fmi2DoStep(one.fmu.component, k * SAMPLE, SAMPLE, 0) for k in range(3)]
        assert statuses == [WARNING, OK, OK]
        assert [line[1] for line in one.lines] == [WARNING]


@pytest.mark.parametrize("unit", NATIVE_UNITS)
def test_a_wrong_guid_gives_no_instance(unit: str) -> None:
    with pytest.raises(Exception, match="Failed to instantiate"):
        Instance(native_folder(unit), guid="{00000000-0000-0000-0000-000000000000}")


def test_categories_of_the_log() -> None:
    """Notes are logged where logging is on, faults always; fmi2SetDebugLogging chooses."""
    target = np.linalg.pinv(design_of().arrays["static_inverse"]) @ [400.0, 0.0, 0.0, 0.0]
    for logging, categories, expected, faults in (
        (True, None, ["logAll"], 1),
        (False, None, [], 1),
        (True, ["logStatusError"], [], 1),
        (False, ["logAll"], ["logAll"], 0),
        (True, [], [], 0),
    ):
        with instance("FlatnessFeedforward", logging=logging) as one:
            references = [one.references[f"y_target[{k}]"] for k in range(1, len(target) + 1)]
            one.to("stepping")
            if categories is not None:
                names = (c_char_p * len(categories))(*[c.encode() for c in categories])
                one.fmu.fmi2SetDebugLogging(one.fmu.component, int(bool(categories)), len(categories), names)
            one.fmu.setReal([one.references["transition_time"], one.references["voltage_limit"]], [0.2, 500.0])
            one.fmu.setReal(references, list(target))
            assert one.call("doStep", 0.0, (PLANNING_TICKS + 1) * SAMPLE) == OK
            assert [line[2] for line in one.lines] == expected
            assert one.call("doStep", 0.0, -1.0) == ERROR
            assert len(one.lines) == faults


def test_functions_without_a_use_answer_as_the_standard_says() -> None:
    with instance() as one:
        one.to("stepping")
        one.fmu.doStep(0.0, SAMPLE)
        fmu, component = one.fmu, one.fmu.component
        answers = {
            name: one.call(name, component, *arguments)
            for name, arguments in {
                "fmi2CancelStep": (),
                "fmi2GetStatus": (0, c_int()),
                "fmi2GetIntegerStatus": (0, c_int()),
                "fmi2GetStringStatus": (1, c_char_p()),
                "fmi2GetBooleanStatus": (1, c_int()),
            }.items()
        }
        assert answers == {
            "fmi2CancelStep": ERROR,
            "fmi2GetStatus": DISCARD,
            "fmi2GetIntegerStatus": DISCARD,
            "fmi2GetStringStatus": DISCARD,
            "fmi2GetBooleanStatus": DISCARD,
        }
        assert fmu.getRealStatus(2) == SAMPLE
        assert not fmu.getBooleanStatus(3)
        assert one.call("fmi2GetRealOutputDerivatives", component, (c_uint * 1)(8), 1, (c_int * 1)(1), None) == ERROR
        assert one.call("doStep", SAMPLE, SAMPLE) == OK


@pytest.mark.parametrize("unit", NATIVE_UNITS)
def test_saved_states_continue_bit_for_bit(unit: str) -> None:
    """In the same instance, after a reset, and from bytes in another instance."""
    names = {
        "BeamPlant": {"u": 300.0},
        "FlatnessFeedforward": {"y_target": -1e-3},
        "TrackingController": {"y_pm": 1e-4, "x_ref": 0.1},
        "MfcActuator": {"u": 300.0},
        "MfcCompensator": {"u_eff": 300.0},
        "BeamClosedLoop": {"y_target": -1e-3, "force": 0.1},
    }[unit]
    with loaded(native_folder(unit)) as one, loaded(native_folder(unit)) as other:
        one.begin()
        for _ in range(300):
            one.advance(SAMPLE, **names)
        saved = one.saved()

        def rest(instance: Any) -> bytes:
            rows = []
            for k in range(200):
                instance.advance(SAMPLE, **{name: value * (1 - k // 100) for name, value in names.items()})
                rows.append(instance.everything())
            return np.array(rows).tobytes()

        first = rest(one)
        assert rest(one.restore(saved)) == first
        one.call("reset")
        assert rest(one.restore(saved)) == first
        assert rest(other.restore(saved)) == first
        assert other.restore(saved).saved() == saved
        one.advance(SAMPLE).call("terminate")
        ended = one.saved()  # before anything is read
        np.testing.assert_array_equal(other.restore(ended).everything(), one.everything())


def test_states_of_parameters_set_before_initialisation() -> None:
    """A state from before the initialisation keeps them, one from after it brings its matrices along."""
    with loaded(native_folder("BeamPlant")) as one, loaded(native_folder("BeamPlant")) as other:
        one.prepare(**{"beam[1].density": 2000.0, "start_at_rest_under": 200.0})
        early = one.saved()
        one.call("exitInitializationMode")
        late = one.advance(1e-3, u=100.0).saved()
        expected = one.advance(1e-3).everything()
        assert (other.restore(late).advance(1e-3).everything() == expected).all()
        other.restore(early).call("exitInitializationMode")
        assert (other.advance(1e-3, u=100.0).advance(1e-3).everything() == expected).all()


def test_foreign_and_damaged_states_are_refused() -> None:
    with instance() as one, instance("TrackingController") as foreign:
        one.to("stepping")
        foreign.to("stepping")
        state = one.fmu.getFMUstate()
        good = bytes(one.fmu.serializeFMUstate(state))
        alien = bytes(foreign.fmu.serializeFMUstate(foreign.fmu.getFMUstate()))
        flipped = bytearray(good)
        flipped[len(good) // 2] ^= 1
        newer = good[:8] + b"\x03" + good[9:]

        def forged(place: int, content: bytes) -> bytes:
            """Other contents with a checksum that fits."""
            changed = bytearray(good)
            changed[place : place + len(content)] = content
            changed[12:16] = struct.pack("<I", zlib.crc32(bytes(changed[16:])))
            return bytes(changed)

        values = {name: 384 + 8 * one.references[name] for name in ("u[1]", "beam[1].tip_mass", "noise_seed")}
        impossible = [
            forged(56, b"\x09"),
            forged(64, struct.pack("<d", np.inf)),
            forged(64, struct.pack("<d", 1e9)),
            forged(128, b"x" * 256),
            forged(104, struct.pack("<d", np.nan)),
            forged(112, struct.pack("<d", 0.5)),
            forged(values["u[1]"], struct.pack("<d", np.nan)),
            forged(values["beam[1].tip_mass"], struct.pack("<d", -1.0)),
            forged(values["noise_seed"], struct.pack("<d", 1e300)),
        ]
        rules = {
            alien: "must be of the same unit and design, got that of another",
            bytes(flipped): f"must be complete and unchanged, got {len(good)} damaged bytes",
            good[:-1]: f"must be complete and unchanged, got {len(good) - 1} damaged bytes",
            good[:20]: "must be one that this unit saved, got something else",
            b"junk" * 200: "must be one that this unit saved, got something else",
            newer: "must have version 2, got 3",
            **dict.fromkeys(impossible, "must have contents that this unit can have saved"),
        }
        for content, rule in rules.items():
            assert one.call("deSerializeFMUstate", content) == ERROR
            assert one.lines[0][3] == f"fmi2DeSerializeFMUstate: FMU state {rule}"
            assert one.call("setFMUstate", state) == OK
            assert one.call("doStep", 0.0, SAMPLE) == OK
            one.call("setFMUstate", state)
        one.fmu.freeFMUstate(state)


def forged_state_is_refused(unit: str, place: int, saved: float, value: float) -> None:
    """A state after one step with another double in its place, which held `saved`, and a checksum that fits."""
    with instance(unit) as one:
        one.to("stepping")
        one.call("doStep", 0.0, SAMPLE)
        content = bytearray(one.fmu.serializeFMUstate(one.fmu.getFMUstate()))
        at = 384 + 8 * (2 * len(one.references) + place)
        assert struct.unpack_from("<d", content, at) == (saved,)
        struct.pack_into("<d", content, at, value)
        struct.pack_into("<I", content, 12, zlib.crc32(bytes(content[16:])))
        try:
            status = one.call("setFMUstate", one.fmu.deSerializeFMUstate(bytes(content)))
        except FMICallException as refusal:  # may be seen in the bytes
            status = refusal.status
        assert status == ERROR
        assert one.lines[-1][3].endswith("FMU state must have contents that this unit can have saved")
        one.call("reset")
        assert after_a_step(one) == untouched(unit)


@pytest.mark.parametrize(("unit", "place"), [("TrackingController", 4), ("BeamClosedLoop", 0)])
@pytest.mark.parametrize("count", [1e17, 2.5, -1.0, 9.0, np.nan])
def test_a_count_that_a_unit_cannot_have_reached_is_refused(unit: str, place: int, count: float) -> None:
    """By the count of ticks or of steps in the state the next step would not return."""
    forged_state_is_refused(unit, place, 1.0, count)


@pytest.mark.parametrize(
    ("place", "saved", "value"),
    [
        (12, -1000.0, 1e-300),  # lowest voltage of pair 2
        (14, -1000.0, -np.inf),
        (15, 1000.0, -1e-300),  # highest voltage of pair 1
        (16, 1000.0, np.nan),
        (19, 0.0, 2.0),  # saturated samples
        (19, 0.0, 0.5),
        (19, 0.0, -1.0),
    ],
)
def test_limits_that_a_controller_cannot_have_are_refused(place: int, saved: float, value: float) -> None:
    forged_state_is_refused("TrackingController", place, saved, value)


def test_bytes_of_a_state_are_little_endian() -> None:
    """Magic, version, checksum, length, digest, phase, clock; then the values by value reference."""
    with instance() as one:
        one.to("stepping")
        one.fmu.setReal([one.references["u[3]"]], [123.456])
        content = bytes(one.fmu.serializeFMUstate(one.fmu.getFMUstate()))
    magic, version, crc, length = struct.unpack_from("<8sIIQ", content)
    assert (magic, version, length) == (b"flxbeams", 2, len(content))
    assert crc == zlib.crc32(content[16:])
    assert struct.unpack_from("<Qd", content, 56) == (2, 0.0)
    assert struct.unpack_from("<d", content, 384 + 8 * one.references["u[3]"]) == (123.456,)


@pytest.mark.skipif(resident_bytes() is None, reason="resident memory is not known here")
def test_an_instance_takes_its_memory_when_it_steps() -> None:
    """BeamPlant has half a megabyte of matrices; many instances that wait cost next to nothing.

    In a new process: memory that others have given back has to be cleared, and is taken at once then.
    """
    limit = 50_000_000  # bytes
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        assert pool.submit(_memory_of_instances, native_folder("BeamPlant"), 200).result() < limit


def _memory_of_instances(folder: Path, count: int) -> int:
    """Bytes that so many instances take once they are instantiated."""
    description = fmpy.read_model_description(folder)
    before, units = resident(), []
    for k in range(count):
        unit = FMU2Slave(
            guid=description.guid, unzipDirectory=str(folder), instanceName=str(k), modelIdentifier="BeamPlant"
        )
        unit.instantiate()  # FMPy hands out memory by calloc
        units.append(unit)
    taken = resident() - before
    for unit in units:
        unit.fmi2FreeInstance(unit.component)
    return taken


def test_instances_in_threads_do_not_touch() -> None:
    """Twenty instances of five units, four threads: each does what it does alone."""

    def work(job: tuple[str, float]) -> bytes:
        unit, level = job
        with loaded(native_folder(unit), f"{unit} {level}") as one:
            one.begin()
            name, scale = {
                "BeamPlant": ("u", 300.0),
                "FlatnessFeedforward": ("y_target", -1e-3),
                "TrackingController": ("y_pm", 1e-4),
                "MfcActuator": ("u", 300.0),
                "MfcCompensator": ("u_eff", 300.0),
            }[unit]
            rows = [one.advance(SAMPLE, **{name: scale * level * (1 + k // 50)}).everything() for k in range(150)]
            return np.array(rows).tobytes()

    jobs = [(unit, level) for level in (0.3, 0.6, 0.9, 1.2) for unit in UNITS]
    alone = [work(job) for job in jobs]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(work, jobs)) == alone
    assert len(set(alone)) == len(jobs)
