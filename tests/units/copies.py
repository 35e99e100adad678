"""Copies of an instance in a process of their own: what saved states and what followed them give there.

    python -m tests.units.copies FILE

FILE is a pickle of the unit's folder and of cases: a serialised state, the host's time, and actions. In its place comes
one of every value that each case ends with.
"""

import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.units.loaded import Loaded, Real, loaded

Story = list[tuple[str, Any]]
Case = tuple[bytes, float, Story]


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


def in_second_process(folder: Path, cases: Sequence[Case], file: Path) -> list[Real]:
    """Every value that an instance ends with in another process, for each case; `file` is written."""
    file.write_bytes(pickle.dumps((folder, list(cases))))
    command = [sys.executable, "-m", __name__, str(file)]
    done = subprocess.run(
        command, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    )
    assert done.returncode == 0, done.stderr[-4000:]
    results: list[Real] = pickle.loads(file.read_bytes())
    return results


def main(file: Path) -> None:
    folder, cases = pickle.loads(file.read_bytes())
    results = []
    with loaded(folder) as unit:
        for content, now, story in cases:
            unit.restore(content).now = now
            results.append(replay(unit, story).everything())
    file.write_bytes(pickle.dumps(results))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
