"""Copies of an instance in a process of their own: what saved states and what followed them give there."""

import os
import threading
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

from tests.units.loaded import Loaded, Real, loaded

Story = list[tuple[str, Any]]
Case = tuple[bytes, float, Story]  # a serialised state, the host's time, and the actions that follow


def replay(unit: Loaded, story: Story) -> Loaded:
    """Does the actions of a story: begin, a step, or the value of a variable."""
    for action, value in story:
        if action == "begin":
            unit.begin(value[0], **value[1])
        elif action == "step":
            unit.advance(value)
        else:
            unit.put(action, value)
    return unit


def ends_of(folder: Path, cases: Sequence[Case]) -> tuple[list[Real], int]:
    """Every value that an instance ends with, for each case, and the number of its FMI calls.

    A state is restored over what the case before has left, or just after the instantiation, in turn.
    """
    with loaded(folder) as unit:
        results = []
        for k, (content, now, story) in enumerate(cases):
            if k % 2:
                unit.renew()
            unit.restore(content).now = now
            results.append(replay(unit, story).everything())
        return results, unit.call_count


def _end_with_parent() -> None:
    """Ends this process as soon as the one that started it is gone, however that ends."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@cache
def _second_process() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_end_with_parent)


def in_second_process(folder: Path, cases: Sequence[Case]) -> tuple[list[Real], int]:
    """`ends_of` in another process, one for all calls; it starts with the first."""
    return _second_process().submit(ends_of, folder, cases).result()
