"""Interface between a unit and its kernel: hooks that a kernel fills in, services that it can use."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

import numpy as np
from numpy.typing import DTypeLike, NDArray
from pythonfmu.enums import Fmi2Status

from flexbeams.fmus.python.clock import Clock
from flexbeams.fmus.python.tables import Tables


class UnitError(Exception):
    """A call the unit refuses; its text becomes the line in the log, where the wrapper writes its repr."""

    def __repr__(self) -> str:
        return str(self)


class CallError(UnitError):
    """A call that sets or gets variables and is refused: it has changed nothing, and the instance goes on."""


class Kernel(ABC):
    """The mathematics of a unit, by four hooks.

    `values` (n,) holds every Real, Integer and Boolean variable at its value reference, `data` the arrays and
    `meta` the plain values of the data file. What changes in a step must live in `values` or in a
    `state_array`: together with phase and `clock` these are the FMU state.
    """

    log: Callable[[str, Fmi2Status], None]  # queues one line for the importer; pythonfmu's base class has it

    def _load(self, tables: Tables) -> None:
        """Take data and start values from the tables."""
        self._tables = tables
        self.data = tables.data
        self.meta = tables.meta
        self.values: NDArray[np.float64] = tables.values.copy()
        self._texts = dict(tables.texts)
        self.clock = Clock()
        self._state: dict[str, NDArray[Any]] = {}
        self._constructing = True
        self._early_lines: list[tuple[str, Fmi2Status]] = []

    # Hooks

    def setup(self) -> None:  # noqa: B027 (optional)
        """Once, at construction: take views, allocate state arrays."""

    def initialise(self) -> None:  # noqa: B027 (optional)
        """Compute the first state and outputs from parameters and inputs.

        Runs at the end of the initialisation, and before it whenever a value is read after one was set: it
        must not build on its own earlier results.
        """

    def restore(self) -> None:  # noqa: B027 (optional)
        """After values and state arrays were replaced by those of an initialised unit: rebuild what derives from them.

        UnitError, by `_refuse_state`, for contents that no saved state has.
        """

    @abstractmethod
    def advance(self, time: float, step: float) -> None:
        """Move state and outputs from `time` to `time + step` (s since the start), the inputs held."""

    @staticmethod
    def _refuse_state() -> NoReturn:
        raise UnitError("FMU state must have contents that this unit can have saved")

    def _compute(self, results: Callable[[], None]) -> None:
        """Values from `results`; where it fails, or one is not finite, they stay what they are."""
        values, before = self.values, self.values.copy()
        try:
            results()
            finite = np.isfinite(values)
            if finite.all():
                return
            place = int(np.argmin(finite))
            name, value = self._tables.variables[place]["name"], float(values[place])
            raise UnitError(f"{name} must be finite, a step gives {value!r}: it keeps its last value")
        except BaseException:
            values[:] = before
            raise

    # Services

    def span(self, name: str) -> slice:
        """Indices in `values` of an array variable or of a scalar one."""
        if name not in self._tables.spans:
            raise UnitError(f"{self._tables.unit_name} has no variable {name}")
        return self._tables.spans[name]

    def view(self, name: str) -> NDArray[np.float64]:
        """The values of an array variable, or of a scalar one as an array of length 1; not a copy."""
        return self.values[self.span(name)]

    def text(self, name: str) -> str:
        """Value of a String variable."""
        return self._texts[self.span(name).start]

    def state_array(self, name: str, shape: int | Sequence[int], dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """A zeroed array that is part of the FMU state; to be written in place."""
        if name in self._state:
            raise UnitError(f"state array {name} exists already")
        array = np.zeros(shape, dtype)
        self._state[name] = array
        return array

    def warn(self, message: str) -> None:
        """Log one line with status fmi2Warning."""
        self._write_line(Fmi2Status.warning, message)

    def note(self, message: str) -> None:
        """Log one line with status fmi2OK."""
        self._write_line(Fmi2Status.ok, message)

    def _write_line(self, status: Fmi2Status, message: str) -> None:
        """Queue one line; during construction hold it until the wrapper reads the log."""
        line = one_line(message)
        if self._constructing:
            self._early_lines.append((line, status))
        else:
            self.log(line, status)

    def _release_early_lines(self) -> None:
        for line, status in self._early_lines:
            self.log(line, status)
        self._early_lines.clear()


def one_line(text: str) -> str:
    """The text without line breaks and without what UTF-8 cannot hold, on which the wrapper would crash."""
    return " ".join(text.splitlines()).encode("utf-8", "replace").decode("utf-8")


def failure_text(error: BaseException) -> str:
    """The text of a refusal; of any other error its type, text and place."""
    try:
        if isinstance(error, UnitError):
            return str(error)
        last = error.__traceback__
        while last is not None and last.tb_next is not None:
            last = last.tb_next
        place = f" (line {last.tb_lineno} of {last.tb_frame.f_code.co_name})" if last else ""
        return f"{type(error).__name__}: {error}{place}"
    except Exception:  # an error whose own text fails
        return type(error).__name__
