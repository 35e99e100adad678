"""The base of the Python units through FMPy. Each run has a process of its own: a crash must not be ours."""

from __future__ import annotations

import gc
import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from ctypes import POINTER, c_double, c_uint, cast
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import fmpy
import fmpy.validation
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

from flexbeams.fmus.errors import BuildError
from flexbeams.fmus.packaging.python import (
    build_python_units,
    bundled_script,
    write_sources,
)
from flexbeams.fmus.python.kernel import UnitError
from flexbeams.fmus.units.native_kernel import UnitData
from tests.units import lag_interface as lag
from tests.units.lag import Lag
from tests.units.lag_interface import lag_unit, step_size

ok, warning, fatal = 0, 1, 4
reference = lag.lag_interface().reference
u = list(lag.lag_interface().references("u"))
y = list(lag.lag_interface().references("y"))
w = list(lag.lag_interface().references("w"))


class Instance:
    """An instance of an extracted unit whose calls return status and log lines instead of raising."""

    def __init__(self, folder: str, name: str = "lag") -> None:
        description = fmpy.read_model_description(folder)
        self.lines: list[tuple[int, str, str]] = []
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self._logger = fmi2CallbackLoggerTYPE(self._log)
        callbacks = fmi2CallbackFunctions()
        callbacks.logger = self._logger
        self.fmu.instantiate(callbacks=callbacks, loggingOn=True)

    def _log(self, _: Any, name: bytes, status: int, category: bytes | None, message: bytes) -> None:
        self.lines.append((status, (category or b"").decode(), message.decode()))

    def __getattr__(self, function: str) -> Callable[..., Any]:
        return partial(self.call, function)

    def call(self, function: str, *arguments: Any, **named: Any) -> tuple[int, Any, list[tuple[int, str, str]]]:
        """Status, returned value and the lines logged during the call."""
        self.lines.clear()
        try:
            status, value = ok, getattr(self.fmu, function)(*arguments, **named)
        except FMICallException as exception:
            status, value = exception.status, None
        return status, value, list(self.lines)

    def start(self, **named: Any) -> Instance:
        self.setupExperiment(startTime=0.0, **named)
        self.enterInitializationMode()
        self.exitInitializationMode()
        return self

    def values(self, references: list[int]) -> list[float]:
        return self.fmu.getReal(references)  # type: ignore[no-any-return]

    def step(self, k: int, inputs: Any = None) -> tuple[int, Any, list[tuple[int, str, str]]]:
        if inputs is not None:
            self.setReal(u, list(inputs))
        return self.call("doStep", k * step_size, step_size)

    def outputs(self) -> tuple[list[float], list[int], list[bool]]:
        return (
            self.values([0, *y, *w]),
            self.fmu.getInteger([reference("ticks")]),
            self.fmu.getBoolean([reference("positive")]),
        )


def excitation(steps: int) -> np.ndarray:
    return np.random.default_rng(7).normal(0.0, 10.0, (steps, 3))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> str:
    built = tmp_path_factory.mktemp("lag")
    build_python_units([lag_unit(built / "lag.fmu"), lag_unit(built / "other.fmu", scale=-3.0)])
    for name in ("lag", "other"):
        fmpy.extract(built / f"{name}.fmu", unzipdir=built / name)
    return str(built)


@pytest.fixture
def isolated() -> Iterator[Callable[..., Any]]:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        yield lambda function, *arguments: pool.submit(function, *arguments).result(timeout=120)


def life_cycle(folder: str) -> dict[str, Any]:
    unit = Instance(f"{folder}/lag")
    seen: dict[str, Any] = {"strings": unit.getString([reference("label"), reference("design_id")])[1]}
    seen["starts"] = unit.values([*u, *range(reference("gain[1]"), reference("trim") + 1)])
    calls = [unit.setupExperiment(startTime=0.5, stopTime=20.0), unit.enterInitializationMode()]
    calls += [
        unit.setReal([reference("gain[2]"), reference("x_start[1]")], [4.0, -0.7]),
        unit.setInteger([reference("substeps")], [3]),
        unit.setBoolean([reference("sluggish")], [True]),
        unit.setString([reference("label")], ["ünit"]),
    ]
    seen["in_initialisation"] = unit.values(y)
    calls.append(unit.exitInitializationMode())
    seen["label"] = unit.getString([reference("label")])[1]
    trace = []
    for k, inputs in enumerate(excitation(40)):
        trace.append(unit.outputs())
        calls += [unit.setReal([u[2], u[0], u[1]], list(inputs[[2, 0, 1]])), unit.doStep(0.5 + k * 0.1, 0.1)]
        calls.append(unit.setReal([reference("trim")], [0.25]))
    calls.append(unit.terminate())
    seen["trace"] = trace
    seen["last"] = unit.outputs()
    unit.freeInstance()
    seen["notes"] = calls[0][2]
    seen["complaints"] = [call for call in calls[1:] if call[0] != ok or call[2]]
    return seen


def test_life_cycle_follows_the_recursion(folder: str, isolated: Callable[..., Any]) -> None:
    seen = isolated(life_cycle, folder)
    assert seen["complaints"] == []
    assert seen["notes"] == [(ok, "logAll", "scale 2.0")]
    assert seen["strings"] == [b"a<b & \xc3\xbc", b"0123abcd"]
    assert seen["label"] == ["ünit".encode()]
    assert seen["starts"] == [0.0, 0.0, 0.0, *lag.gain, *lag.x_start, 0.0]
    gain = np.array([lag.gain[0], 4.0])
    x = 2.0 * np.array([-0.7, lag.x_start[1]])
    assert seen["in_initialisation"] == (gain * x).tolist()
    trim = 0.0
    inputs = np.zeros(3)
    for k, (values, ticks, positive) in enumerate([*seen["trace"], seen["last"]]):
        assert values[0] == pytest.approx(0.5 + k * 0.1, rel=1e-14)
        np.testing.assert_allclose(values[1:3], gain * x + trim, rtol=1e-12)
        np.testing.assert_allclose(values[3:], np.outer(x, inputs).ravel(), rtol=1e-12)
        assert (ticks, positive) == ([3 * k], [x[0] > 0.0])
        if k < 40:
            inputs = excitation(40)[k]
            trim = 0.25 if k else 0.0
            for _ in range(3):
                x = 0.5 * lag.a * x + lag.b @ inputs


def interleaved(folder: str) -> list[Any]:
    """Two designs of one unit, two instances of the first, each against itself alone."""
    alone = []
    for name in ("lag", "other"):
        unit = Instance(f"{folder}/{name}").start()
        alone.append([(unit.step(k, v)[0], unit.outputs()) for k, v in enumerate(excitation(20))])
        unit.freeInstance()
    units = [Instance(f"{folder}/{name}", f"i{i}").start() for i, name in enumerate(("lag", "other", "lag"))]
    together: list[Any] = [[], [], []]
    for k, inputs in enumerate(excitation(20)):
        for unit, trace in zip(units, together, strict=True):
            trace.append((unit.step(k, inputs)[0], unit.outputs()))
    for unit in units:
        unit.freeInstance()
    return [alone, together]


def test_instances_and_designs_in_one_process_do_not_touch(folder: str, isolated: Callable[..., Any]) -> None:
    (first, second), together = isolated(interleaved, folder)
    assert together == [first, second, first]
    assert first[0][1][0][1:3] != second[0][1][0][1:3]


def saved_and_restored(folder: str) -> dict[str, Any]:
    unit = Instance(f"{folder}/lag")
    other = Instance(f"{folder}/lag", "second").start()
    unit.setupExperiment(startTime=0.0)
    unit.setString([reference("label")], ["kept"])
    unit.setBoolean([reference("sluggish")], [True])
    early = unit.fmu.getFMUstate()
    unit.enterInitializationMode()
    unit.exitInitializationMode()
    inputs = excitation(30)
    for k in range(10):
        unit.step(k, inputs[k])
    state = unit.fmu.getFMUstate()
    stored = unit.fmu.serializeFMUstate(state)

    def rest(instance: Instance) -> bytes:
        trace = []
        for k in range(10, 30):
            assert instance.step(k, inputs[k])[0] == ok
            values, ticks, positive = instance.outputs()
            trace.append([*values, *ticks, *positive])
        return np.array(trace).tobytes()

    runs = [rest(unit)]
    unit.setFMUstate(state)
    runs.append(rest(unit))
    unit.terminate()
    unit.setFMUstate(state)
    runs.append(rest(unit))
    copied = other.fmu.deSerializeFMUstate(stored)
    seen: dict[str, Any] = {"restore": other.setFMUstate(copied), "label": other.getString([reference("label")])[1]}
    runs.append(rest(other))
    seen["again"] = other.fmu.serializeFMUstate(copied) == stored
    unit.setFMUstate(early)
    seen["early"] = [unit.setBoolean([reference("sluggish")], [False]), unit.enterInitializationMode()]
    seen["runs"] = runs
    for instance, states in ((unit, (state, early)), (other, (copied,))):
        for one in states:
            instance.fmu.freeFMUstate(one)
        instance.freeInstance()
    return seen


def test_saved_state_continues_bit_for_bit(folder: str, isolated: Callable[..., Any]) -> None:
    seen = isolated(saved_and_restored, folder)
    assert seen["restore"] == (ok, None, [])
    assert seen["label"] == [b"kept"]
    assert len(set(seen["runs"])) == 1
    assert seen["again"]
    assert [call[::2] for call in seen["early"]] == [(ok, []), (ok, [])]


def damaged_states(folder: str) -> tuple[list[Any], int]:
    unit = Instance(f"{folder}/lag").start()
    other = Instance(f"{folder}/other").start()
    unit.step(0, [1.0, 2.0, 3.0])
    state = unit.fmu.getFMUstate()
    good = unit.fmu.serializeFMUstate(state)
    foreign = other.fmu.serializeFMUstate(other.fmu.getFMUstate())
    flipped = bytearray(good)
    flipped[len(good) // 2] ^= 1
    version = good[:8] + b"\3" + good[9:]
    seen = []
    for content in (foreign, bytes(flipped), good[:-1], good[:20], b"junk" * 99, version, good + b"\0"):
        before = unit.outputs()
        status, value, lines = unit.deSerializeFMUstate(content)
        seen.append((status, lines, *unit.setFMUstate(value), unit.outputs() == before, unit.step(1)[0]))
        unit.setFMUstate(state)
        unit.fmu.freeFMUstate(value)
    return seen, unit.step(1)[0]


def test_foreign_and_damaged_states_are_refused(folder: str, isolated: Callable[..., Any]) -> None:
    refusals, last = isolated(damaged_states, folder)
    rules = [
        "got that of another",
        "damaged",
        "damaged",
        "something else",
        "something else",
        "version 2, got 3",
        "damaged",
    ]
    for refusal, rule in zip(refusals, rules, strict=True):
        *before, lines, unchanged, step = refusal
        assert before == [ok, [], fatal, None]
        assert [line[0] for line in lines] == [fatal]
        assert rule in lines[0][2]
        assert unchanged
        assert step == fatal
    assert last == ok


# name: (phase, call, arguments, text of the log)
misuses: dict[str, tuple[str, str, tuple[Any, ...], str]] = {
    "unknown get": ("stepping", "getReal", ([u[0], 99],), "value reference must be within 0..22, got 99"),
    "huge get": ("stepping", "getReal", ([2**32 - 1],), "got 4294967295"),
    "unknown set": ("stepping", "setReal", ([2**31], [1.0]), "value reference must be within 0..22, got 2147483648"),
    "wrong type": ("stepping", "getReal", ([reference("ticks")],), "ticks is Integer, got a call for Real"),
    "real as boolean": ("stepping", "getBoolean", (y,), "y[1] is Real, got a call for Boolean"),
    "real as string": ("stepping", "getString", (y,), "y[1] is Real, got a call for String"),
    "string as integer": ("initialising", "setInteger", ([reference("label")], [1]), "label is String"),
    "output": ("initialising", "setReal", (y, [1.0, 2.0]), "y[1] is output and cannot be set, got 1.0"),
    "local": ("initialising", "setReal", ([w[5]], [1.0]), "w[2,3] is local and cannot be set"),
    "time": ("stepping", "setReal", ([0], [1.0]), "time is independent and cannot be set"),
    "constant": ("initialising", "setString", ([reference("design_id")], ["x"]), "design_id is local"),
    "fixed": ("stepping", "setReal", ([reference("gain[2]")], [1.0]), "gain[2] is fixed and cannot be set after"),
    "fixed text": ("stepping", "setString", ([reference("label")], ["x"]), "label is fixed"),
    "minimum": ("initialising", "setReal", ([reference("gain[1]")], [-0.5]), "gain[1] must be >= 0.0, got -0.5"),
    "maximum": ("stepping", "setReal", ([reference("trim")], [1.5]), "trim must be <= 1.0, got 1.5"),
    "integer": ("initialising", "setInteger", ([reference("substeps")], [0]), "substeps must be >= 1, got 0"),
    "nan": ("stepping", "setReal", (u, [0.0, float("nan"), 0.0]), "u[2] must be finite, got nan"),
    "infinity": ("initialising", "setReal", (u, [0.0, 0.0, float("-inf")]), "u[3] must be finite, got -inf"),
    "step of zero": ("stepping", "doStep", (0.0, 0.0), "communicationStepSize must be finite and > 0, got 0.0"),
    "step back": ("stepping", "doStep", (0.0, -0.1), "communicationStepSize must be finite and > 0, got -0.1"),
    "endless step": ("stepping", "doStep", (0.0, float("inf")), "communicationStepSize must be finite"),
    "gap": ("stepping", "doStep", (0.5, 0.1), "must be 0.0, the end of the last step, got 0.5"),
    "nan time": ("stepping", "doStep", (float("nan"), 0.1), "currentCommunicationPoint must be 0.0"),
    "early step": ("initialising", "doStep", (0.0, 0.1), "fmi2DoStep needs an instance initialised"),
    "late setup": ("stepping", "setupExperiment", (), "fmi2SetupExperiment needs an instance just instantiated"),
    "initialised twice": ("stepping", "enterInitializationMode", (), "fmi2EnterInitializationMode needs"),
    "not entered": ("instantiated", "exitInitializationMode", (), "fmi2ExitInitializationMode needs"),
    "terminated early": ("instantiated", "terminate", (), "fmi2Terminate needs an instance initialised"),
    "set after end": ("terminated", "setReal", (u, [1.0, 2.0, 3.0]), "no variable can be set after fmi2Terminate"),
}  # fmt: skip


def misused(folder: str) -> dict[str, Any]:
    seen = {}
    phases = ("instantiated", "initialising", "stepping", "terminated")
    for name, (phase, function, arguments, _) in misuses.items():
        unit = Instance(f"{folder}/lag", name)
        steps = (partial(unit.setupExperiment, startTime=0.0), unit.enterInitializationMode)
        for call in (*steps, unit.exitInitializationMode, unit.terminate)[: (0, 2, 3, 4)[phases.index(phase)]]:
            call()
        # A call with cached references must be checked like the first one.
        unit.getReal([*y, *u])
        if phase == "stepping":
            unit.setReal(u, [0.0, 0.0, 0.0])
        before = unit.getReal(list(range(reference("substeps"))))[1]
        attempts = [unit.call(function, *arguments) for _ in range(3)]
        after = unit.getReal(list(range(reference("substeps"))))[1]
        if phase == "initialising":
            unit.exitInitializationMode()
        following = unit.doStep(0.0, 0.1)
        unit.reset()
        unit.setupExperiment(startTime=0.0)
        again = [unit.enterInitializationMode(), unit.exitInitializationMode(), unit.doStep(0.0, 0.1)]
        unit.freeInstance()
        seen[name] = (attempts, before == after, following, again)
    return seen


def test_misuse_is_refused_with_one_line_and_no_crash(folder: str, isolated: Callable[..., Any]) -> None:
    """Getters and setters do no harm, after others no step until fmi2Reset."""
    for name, (attempts, unchanged, following, again) in isolated(misused, folder).items():
        phase, function, _, text = misuses[name]
        for status, _, lines in attempts:
            assert status == fatal, name
            assert [line[0] for line in lines] == [fatal], name
            assert text in lines[0][2], name
        assert unchanged, name
        harmless = function[3:] in ("Real", "Integer", "Boolean", "String") and phase != "terminated"
        assert following[0] == (ok if harmless else fatal), name
        assert [call[::2] for call in again] == [(ok, [])] * 3, name


def kernel_faults(folder: str) -> list[Any]:
    unit = Instance(f"{folder}/lag")
    seen: list[Any] = []
    for fault in (2e6, -2e6):
        unit.start()
        warned = unit.step(0, [0.0, 2e6, 1.0])
        seen.append([warned, unit.step(1, [0.0, 0.0, fault]), unit.step(1), unit.step(1)])
        unit.reset()
        unit.start()
        seen[-1].append(unit.step(0))
        unit.reset()
    unit.setString([reference("label")], ["broken"])
    unit.setupExperiment(startTime=0.0)
    unit.enterInitializationMode()
    seen.append([unit.getReal(y), unit.exitInitializationMode(), unit.exitInitializationMode(), unit.step(0)])
    seen.append({len(unit.getReal([99])[2]) for _ in range(500)})
    unit.freeInstance()
    return seen


def test_faults_of_the_kernel_are_reported_and_contained(folder: str, isolated: Callable[..., Any]) -> None:
    refusal, fault, initial, counts = isolated(kernel_faults, folder)
    assert refusal[1][2][0][2].endswith("\nu[3] is large; u[3] must be <= 1e6, got 2000000.0")
    assert "\nZeroDivisionError: kernel fault ? (line " in fault[1][2][0][2]
    assert fault[1][2][0][2].endswith(" of advance)")
    for warned, first, second, third, after_reset in (refusal, fault):
        assert warned == (ok, None, [(warning, "logStatusWarning", "u[2] is large")])
        assert [call[0] for call in (first, second, third, after_reset)] == [fatal, fatal, fatal, ok]
        assert [len(call[2]) for call in (first, second, third, after_reset)] == [1, 1, 1, 0]
        assert "the instance failed: " in second[2][0][2]
    for status, _, lines in initial:
        assert status == fatal
        assert len(lines) == 1
        assert lines[0][2].endswith("label must not be broken")
    assert counts == {1}


def reset_values(folder: str) -> list[Any]:
    unit = Instance(f"{folder}/lag")
    every = list(range(reference("substeps")))
    seen = []
    for _ in range(3):
        seen.append((unit.values(every), unit.getString([reference("label")])[1]))
        unit.setReal([reference("gain[1]")], [7.0])
        unit.setString([reference("label")], ["other"])
        unit.start()
        unit.step(0, [1.0, 2.0, 3.0])
        unit.reset()
    unit.freeInstance()
    return seen


def test_reset_brings_back_the_start_values(folder: str, isolated: Callable[..., Any]) -> None:
    first, second, third = isolated(reset_values, folder)
    declared = [float(v.start or 0.0) for v in lag.lag_interface().variables[: reference("substeps")]]
    assert first == second == third == (declared, [b"a<b & \xc3\xbc"])


def many_instances(folder: str) -> dict[str, Any]:
    """Two hundred instances one after the other, then forty at once, from two extracted copies."""
    copy = Path(folder) / "copy"
    shutil.copytree(Path(folder) / "lag", copy, dirs_exist_ok=True)
    before = len(sys.path)
    for i in range(200):
        unit = Instance(f"{folder}/lag" if i % 2 else str(copy)).start()
        assert unit.step(0, [1.0, 2.0, 3.0])[0] == ok
        unit.freeInstance()
        if i == 20:
            gc.collect()
            objects = len(gc.get_objects())
    gc.collect()
    seen: dict[str, Any] = {"added": len(sys.path) - before, "objects": (len(gc.get_objects()) - objects) / 180}
    units = [Instance(str(copy), str(i)).start() for i in range(40)]
    seen["outputs"] = len({str((unit.step(0, [1.0, 2.0, 3.0]), unit.outputs())) for unit in units})
    shutil.rmtree(f"{copy}/resources")
    units[0].reset()
    seen["reset"] = units[0].start().step(0)
    for unit in units:
        unit.freeInstance()
    return seen


@pytest.mark.slow
def test_many_instances_in_one_process(folder: str, isolated: Callable[..., Any]) -> None:
    seen = isolated(many_instances, folder)
    assert seen["added"] <= 2
    assert seen["objects"] < 100
    assert seen["outputs"] == 1
    assert seen["reset"] == (ok, None, [])


def cached_calls(folder: str) -> list[Any]:
    """Direct calls with buffers, as fast masters make them; every kind of selection of references."""
    unit = Instance(f"{folder}/lag").start()
    unit.step(0, [1.0, 2.0, 3.0])
    every = np.array(unit.values(list(range(reference("substeps")))))
    rng = np.random.default_rng(3)
    seen = []
    for n in (0, 1, 2, 5, 9) * 80:
        chosen = rng.integers(0, len(every), n)
        references = (c_uint * n)(*chosen)
        buffer = np.full(n, np.nan)
        pointer = cast(buffer.ctypes.data, POINTER(c_double))
        for _ in range(2):
            unit.fmu.fmi2GetReal(unit.fmu.component, references, n, pointer)
        seen.append(np.array_equal(buffer, every[chosen]))
    return seen


def test_every_selection_of_references_is_read_right(folder: str, isolated: Callable[..., Any]) -> None:
    assert all(isolated(cached_calls, folder))


def unreadable_data(folder: str) -> list[str]:
    copy = Path(folder) / "damaged"
    shutil.copytree(Path(folder) / "other", copy)
    (copy / "resources" / "data.npz").write_bytes(b"nothing")
    lines: list[str] = []
    description = fmpy.read_model_description(copy)
    fmu = FMU2Slave(guid=description.guid, unzipDirectory=str(copy), modelIdentifier="LagUnit", instanceName="d")
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = fmi2CallbackLoggerTYPE(lambda *call: lines.append(call[4].decode()))
    try:
        fmu.instantiate(callbacks=callbacks, loggingOn=True)
    except Exception as exception:
        lines.append(str(exception))
    return lines


def test_unreadable_data_file_gives_no_instance(folder: str, isolated: Callable[..., Any]) -> None:
    logged, raised = isolated(unreadable_data, folder)
    assert "initialize" in logged
    assert "Failed to instantiate" in raised


def test_unit_satisfies_fmpy(folder: str) -> None:
    assert fmpy.validation.validate_fmu(str(Path(folder) / "lag.fmu")) == []
    description = fmpy.read_model_description(Path(folder) / "lag.fmu")
    assert description.coSimulation.needsExecutionTool
    assert not description.coSimulation.canBeInstantiatedOnlyOncePerProcess


def test_same_inputs_give_the_same_bytes_anywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    unit = lag_unit(tmp_path / "first.fmu")
    first = build_python_units([unit])[0].read_bytes()
    elsewhere = tmp_path / "else" / "where"
    kernel = tmp_path / "kernel.py"
    shutil.copyfile(lag.KERNEL, kernel)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    data = replace(unit.data, arrays={"b": np.asfortranarray(lag.b), "a": lag.a.astype(">f8")})
    second = replace(unit, kind=lag.lag_kind(kernel), data=data, out=elsewhere / "x.fmu")
    assert build_python_units([second])[0].read_bytes() == first
    assert os.listdir(elsewhere) == ["x.fmu"]
    assert str(tmp_path).encode() not in first
    with zipfile.ZipFile(tmp_path / "first.fmu") as archive:
        assert archive.namelist() == sorted(archive.namelist())
        assert {info.date_time for info in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        assert not [name for name in archive.namelist() if "__pycache__" in name]


@pytest.mark.parametrize("changed", ["data", "meta", "interface"])
def test_every_content_changes_guid_and_module_name(tmp_path: Path, changed: str) -> None:
    first = lag_unit(tmp_path)
    second = {
        "data": replace(first, data=replace(first.data, arrays={"a": lag.a, "b": np.nextafter(lag.b, 9.0)})),
        "meta": replace(first, data=replace(first.data, meta={"scale": 2.5})),
        "interface": replace(first, interface=replace(lag.lag_interface(), stop_time=2.0)),
    }[changed]
    names, descriptions = zip(*(write_sources(unit, tmp_path) for unit in (first, second)), strict=True)
    assert names[0] != names[1]
    assert descriptions[0] != descriptions[1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "import flexbeams.plant.structure\n",
            "must import from this project by `from ... import` at the top, got flexbeams.plant.structure",
        ),
        ("def f():\n    import flexbeams.fmus\n", "at the top, got flexbeams.fmus"),
        ("from . import helper\n", "at the top, got ."),
        ("x = 1\n", "one class must derive from Unit, got none"),
        ("class A(Unit): ...\nclass B(Unit): ...\n", "one class must derive from Unit, got A, B"),
        (
            "from flexbeams.fmus.python.nowhere import x\n",
            "must import plain names of a module of this project, got from flexbeams.fmus",
        ),
        ("from flexbeams.fmus.python.kernel import UnitError as E\n", "must import plain names"),
        ("def pack_state():\n    pass\n", "pack_state must be defined once in a unit"),
        ("class A(Unit):\n    pass\n", "pythonfmu could not build the unit"),
        ("import no_such_module\nclass A(Unit):\n    def advance(self, t, h): ...\n", "no_such_module"),
    ],
)
def test_kernels_that_cannot_be_bundled_are_refused(tmp_path: Path, text: str, message: str) -> None:
    kernel = tmp_path / "kernel.py"
    kernel.write_text("from flexbeams.fmus.python.slave import Unit\n" + text)
    with pytest.raises(BuildError, match=message.replace(".", r"\.")):
        build_python_units([replace(lag_unit(tmp_path / "x.fmu"), kind=lag.lag_kind(kernel))])
    assert not (tmp_path / "x.fmu").exists()


def test_project_modules_are_joined_before_the_kernel(tmp_path: Path) -> None:
    kernel = tmp_path / "kernel.py"
    text = lag.KERNEL.read_text(encoding="utf-8")
    kernel.write_text(
        text.replace("import numpy as np\n", "import numpy as np\n\nfrom flexbeams.plant.errors import InputError\n")
    )
    script, name = bundled_script(kernel)
    parts = ("class InputError", "class Tables", "class Kernel(", "class Unit(", "class Lag(")
    assert name == "Lag"
    assert sorted(parts, key=script.index) == [*parts]
    assert all(script.count(part) == 1 for part in parts)
    assert "from flexbeams" not in script


def test_unit_needs_nothing_of_the_project(folder: str, tmp_path: Path) -> None:
    code = "import fmpy, sys; print(len(fmpy.simulate_fmu(sys.argv[1], stop_time=0.01)), 'flexbeams' in sys.modules)"
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [sys.executable, "-c", code, f"{folder}/lag.fmu"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["11", "False"]


def test_data_that_is_not_numeric_is_refused(tmp_path: Path) -> None:
    unit = lag_unit(tmp_path / "x.fmu")
    with pytest.raises(BuildError, match=r"data\['name'\] must be numeric"):
        build_python_units([replace(unit, data=UnitData(arrays={"name": np.array(["text"])}))])


def test_kernel_sees_its_data_read_only_and_named_views(tmp_path: Path) -> None:
    write_sources(lag_unit(tmp_path / "x.fmu"), tmp_path)
    kernel = Lag(instance_name="direct", resources=str(tmp_path))
    assert kernel.meta == {"scale": 2.0}
    np.testing.assert_array_equal(kernel.data["b"], lag.b)
    with pytest.raises(ValueError, match="read-only"):
        kernel.data["a"][0] = 1.0
    kernel.view("w")[:] = np.arange(6.0)
    assert kernel.get_real(w) == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert kernel.view("substeps").tolist() == [2.0]
    with pytest.raises(UnitError, match="LagUnit has no variable v"):
        kernel.view("v")
    with pytest.raises(UnitError, match="state array x exists already"):
        kernel.state_array("x", 3)
