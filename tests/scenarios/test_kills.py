"""Commands ended at random moments: no half-written file, no temporary folder after the next command, a sound cache.

FLEXBEAMS_KILLS=100 is the full trial, which takes some minutes.
"""

import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexbeams.fmus.packaging.cache import cached_files, is_sound
from tests.helpers import python_environment

KILLS = int(os.environ.get("FLEXBEAMS_KILLS", "3"))
pytestmark = [
    pytest.mark.native,
    pytest.mark.skipif(os.name != "posix", reason="signals of POSIX"),
    pytest.mark.timeout(60 + 10 * KILLS),
]
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
SCENARIO = """title = "long"
structure = "single_beam"
stop_time = 20.0
[instance.plant]
unit = "BeamPlant"
[[input]]
to = "plant.u"
constant = 10.0
[[figure]]
file = "motion"
rows = [["plant.y_pi"]]
"""


class Trial:
    """A folder with a cache and temporary files of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.temporary, self.cache = folder, folder / "temporary", folder / "cache"
        self.temporary.mkdir()
        (folder / "long.toml").write_text(SCENARIO)

    def start(self, *arguments: str) -> "subprocess.Popen[bytes]":
        environment = python_environment(TMPDIR=str(self.temporary), FLEXBEAMS_CACHE=str(self.cache))
        return subprocess.Popen(
            [sys.executable, "-m", "flexbeams", *arguments],
            cwd=self.folder,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )

    def broken(self) -> Iterator[str]:
        """What is wrong in the folders."""
        for file in cached_files(self.cache) if self.cache.is_dir() else ():
            if not is_sound(file, self.cache):
                yield f"{file} does not have its hash"
        summary = self.folder / "out/summary.json"
        if summary.is_file():
            told = json.loads(summary.read_text())
            for name, content_hash in told["files"].items():
                file = self.folder / "out" / name
                present = hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else None
                if present != content_hash and (not told.get("unfinished") or present != told["replaced"].get(name)):
                    yield f"{name} is not as the summary lists it"
        for archive in [*self.folder.glob("*.ssp"), *self.folder.glob("units/*/*.fmu")]:
            if zipfile.ZipFile(archive).testzip() is not None:
                yield f"{archive} is damaged"


def test_commands_are_killed_at_random_moments(tmp_path: Path) -> None:
    trial, chance = Trial(tmp_path), random.Random(1)
    commands = (
        ("run", "long.toml", "--out", "out", "--format", "csv,mat"),
        ("build", "BeamPlant", "--structure", "single_beam", "--out", "units"),
        ("export", "long.toml", "-o", "long.ssp"),
    )
    longest = dict.fromkeys(commands, 4.0)
    for k in range(KILLS):
        number = SIGNALS[k % len(SIGNALS)]
        arguments = commands[k // len(SIGNALS) % len(commands)]
        begin = time.monotonic()
        process = trial.start(*arguments)
        try:
            _, errors = process.communicate(timeout=chance.uniform(0.3, longest[arguments]))
            longest[arguments] = time.monotonic() - begin
        except subprocess.TimeoutExpired:
            process.send_signal(number)
            _, errors = process.communicate(timeout=60)
        ended = (0, -number, 128 + number)  # a signal before Python has a handler ends it at once
        assert process.returncode in ended, (arguments, process.returncode, errors)
        assert number != signal.SIGTERM or b"Traceback" not in errors, errors
        assert not list(trial.broken()), (k, arguments, number)
    for arguments in commands:
        process = trial.start(*arguments)
        _, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
        assert not list(trial.broken())
    assert not list(trial.temporary.iterdir())
    left = {p.name for p in tmp_path.rglob("*") if p.is_file() and (".tmp" in p.name or p.name.startswith("."))}
    assert not left
