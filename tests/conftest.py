"""Fixtures of several test files, and the number of worker processes of a session."""

import os
import signal
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

from flexbeams.fmus.packaging.compilers import Compiler
from flexbeams.scenarios.definition.settings import Settings
from tests.compilations import compile_anew, compile_once
from tests.helpers import BuiltUnits, Workshop, computed_once, session_folder, with_shared_units
from tests.native.workshop import native_folder, needs_zig
from tests.order import place_of

MOST_WORKERS = 8


def pytest_configure(config: pytest.Config) -> None:
    os.environ["FLEXBEAMS_CACHE"] = str(session_folder() / "build/fmus")  # worker processes inherit both
    if config.getoption("numprocesses", None):
        for library in ("OPENBLAS", "OMP", "MKL"):  # one thread for each worker
            os.environ.setdefault(f"{library}_NUM_THREADS", "1")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: place_of(item.path))
    if find_spec("ziglang") is None:
        for item in items:
            if item.get_closest_marker("native"):
                item.add_marker(pytest.mark.skip(reason="the ziglang wheel is not installed"))


@pytest.hookimpl(tryfirst=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """`-n auto` means one process where test files are named, so that a single test starts at once; else all cores."""
    if any(".py" in argument for argument in config.args):
        return 0
    if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ:
        return None
    affinity = getattr(os, "sched_getaffinity", None)
    return min(MOST_WORKERS, len(affinity(0)) if affinity else os.cpu_count() or 1)


@pytest.fixture(autouse=True, scope="session")
def shared_compilations() -> Iterator[None]:
    """Units of equal sources are compiled once, whatever test exports them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Compiler, "make", compile_once)
        yield


@pytest.fixture
def own_compilations(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every library is compiled, in tests of the compilation itself."""
    monkeypatch.setattr(Compiler, "make", compile_anew)


@pytest.fixture(scope="session")
def workshop() -> Workshop:
    return Workshop()


@pytest.fixture(params=[pytest.param("native", marks=needs_zig), "python"])
def units(request: pytest.FixtureRequest) -> BuiltUnits:
    """Extracted FMUs of each backend in turn."""
    return native_folder if request.param == "native" else Workshop().folder


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder to run the command in."""
    return with_shared_units(tmp_path_factory.mktemp("runs"))


@pytest.fixture
def short(run_folder: Path) -> Callable[..., Settings]:
    """Settings of a run with its units in the session's folder."""
    return lambda **settings: Settings(record_animation=False, build_folder=run_folder / "build/fmus", **settings)


@pytest.fixture
def at_run_folder(run_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The present directory is the folder for runs."""
    monkeypatch.chdir(run_folder)
    return run_folder


@pytest.fixture
def ctrl_c() -> Iterator[None]:
    """SIGINT raises KeyboardInterrupt here and ends child processes, also where this process was started without."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(autouse=True, scope="session")
def known_designs() -> Iterator[None]:
    """Runs and exports in this process take designs that the session has computed already."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("flexbeams.fmus.packaging.designs.compute_design", computed_once)
        yield


@pytest.fixture
def write_scenario(tmp_path: Path) -> Callable[[str, str], Path]:
    """A function that writes a scenario file of a name with a text."""

    def write(name: str, text: str) -> Path:
        path = tmp_path / f"{name}.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write
