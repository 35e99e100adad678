"""Hosts that read and write every variable as Real do no harm, and get all outputs where flags are Real."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexbeams.fmus.choices import Backend
from flexbeams.fmus.packaging.build import build_units
from flexbeams.fmus.units.catalogue import CATALOGUE
from flexbeams.scenarios.simulation.failure import UnitFailure
from tests.helpers import UNITS, Workshop, design_of, extracted_once, made_once
from tests.native.workshop import UNIT, native_folder, needs_zig
from tests.units.loaded import Loaded, Real, loaded

STEPS = 1000
H = 2e-4  # s
INPUTS = {
    "u": 200.0,
    "y_target": np.array([-1e-3, 0.1e-3, 0.5e-3, -0.7e-3]),
    "y_pm": 1e-4,
    "u_ff": 1100.0,
}


def inputs_at(unit: Loaded, k: int) -> dict[str, Real]:
    """Inputs that set flags at some steps and not at others."""
    names = (name for name in INPUTS if f"{name}[1]" in unit.variables)
    on = (k // 200) % 2
    return {n: np.asarray(on * INPUTS[n]) for n in names if unit.variables[f"{n}[1]"].causality == "input"}


def careful_run(folder: Path) -> Real:
    with loaded(folder) as unit:
        unit.begin()
        for k in range(STEPS):
            unit.advance(H, **inputs_at(unit, k))
        return unit.everything()


class CarelessHost:
    """Sets and gets every variable by fmi2SetReal and fmi2GetReal and ignores what it is answered."""

    def __init__(self, unit: Loaded) -> None:
        self._unit = unit
        variables = unit.variables.values()
        self._all = [v.valueReference for v in variables]
        self._others = [v.valueReference for v in variables if v.type != "Real"]
        self._outputs = [v.valueReference for v in variables if v.causality == "output"]
        self.refused: set[str] = set()

    def _try(self, call: Callable[[], object]) -> None:
        try:
            call()
        except UnitFailure as failure:
            self.refused.add(str(failure))
            self._unit.last_error = ""  # which the wrapper of Python units would count for the next step

    def step(self, k: int) -> Real:
        """A step; returns what it reads of the outputs, NaN where it is refused."""
        unit = self._unit
        for reference in self._others:
            self._try(lambda r=reference: unit.call("setReal", [r], [1.0]))  # type: ignore[misc]
        self._try(lambda: unit.call("setReal", self._all, [1e-3] * len(self._all)))
        unit.advance(H, **inputs_at(unit, k))
        for reference in self._others:
            self._try(lambda r=reference: unit.call("getReal", [r]))  # type: ignore[misc]
        read: list[list[float]] = []
        self._try(lambda: read.append(unit.call("getReal", self._outputs)))
        return np.array(read[0] if read else [np.nan] * len(self._outputs))


@needs_zig
@pytest.mark.parametrize("unit", [*UNITS, UNIT])
def test_reading_and_writing_everything_as_real_does_no_harm(unit: str) -> None:
    careless(native_folder(unit))


@pytest.mark.parametrize("unit", UNITS)
def test_the_same_of_the_python_units(unit: str) -> None:
    careless(Workshop().folder(unit))


def careless(folder: Path) -> None:
    with loaded(folder) as one:
        host = CarelessHost(one.begin())
        for k in range(STEPS):
            host.step(k)
        assert any("got a call for Real" in text for text in host.refused)
        np.testing.assert_array_equal(one.everything(), careful_run(folder))


@pytest.mark.slow
@pytest.mark.parametrize("backend", [pytest.param("native", marks=needs_zig), "python"])
def test_flags_as_real_give_such_a_host_all_outputs(backend: Backend) -> None:
    """Flags are 0 or 1 and change; all other values are those of the usual units, to the last bit."""

    def make(folder: Path) -> None:
        build_units(CATALOGUE, design_of(), design_of().model(), folder, backend=backend, flags_as_real=True)

    built = made_once(f"real-{backend}", make) / backend
    usual = native_folder if backend == "native" else Workshop().folder
    for name, flags in {"BeamPlant": 0, "FlatnessFeedforward": 1, "TrackingController": 1}.items():
        with loaded(extracted_once(built / f"{name}.fmu")) as one:
            outputs = [v for v in one.variables.values() if v.causality == "output"]
            assert {v.type for v in outputs} == {"Real"}
            host = CarelessHost(one.begin())
            rows = np.array([host.step(k) for k in range(STEPS)])
            assert np.all(np.isfinite(rows))
            places = [k for k, v in enumerate(outputs) if v.max == "1.0" and v.min == "0.0"]
            assert len(places) == flags
            assert all(set(rows[:, k]) == {0.0, 1.0} for k in places)
            np.testing.assert_array_equal(one.everything(), careful_run(usual(name)))
