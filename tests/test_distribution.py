"""The distribution: one import package, nothing beside it, installed in any way, and light to import."""

import ast
import hashlib
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

from tests.helpers import ROOT, made_once, python_environment

FOLDERS = ("flexbeams", "plant", "controller", "fmus", "scenarios")
NAMESAKES = ("plant", "controller", "scenarios")  # packages of the index with names of our folders
SHIPPED = (
    ".py",
    ".c",
    ".h",
    ".toml",
    ".csv",
    ".js",
    ".css",
    ".j2",
    ".typed",
    ".LICENSE",
    ".ipynb",
)  # by the end of the name
HEAVY = {"numpy", "scipy", "fmpy", "matplotlib", "pydantic", "click", "rich", "importlib.metadata"}
pytestmark = pytest.mark.slow


def run(*command: object, cwd: Path | None = None, **environment: str) -> str:
    """What a command prints; in an environment in which only the installed package can be found."""
    clean = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [*map(str, command)], cwd=cwd, env=clean | environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def pip(*arguments: object) -> str:
    return run(sys.executable, "-m", "pip", "-q", *arguments)


@pytest.fixture(scope="module", autouse=True)
def index() -> Path:
    """The folder of what the tests need of a package index; skipped where there is none."""

    def download(folder: Path) -> None:
        command = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "-d", str(folder)]
        done = subprocess.run([*command, "setuptools>=77", *NAMESAKES], capture_output=True, text=True, check=False)
        if done.returncode == 0:
            (folder / "complete").touch()

    folder = made_once("index", download)
    if not (folder / "complete").exists():
        pytest.skip("no package index within reach")
    return folder


def copy_sources(folder: Path) -> Path:
    """A copy of what a distribution is built from, since builds leave files behind."""
    for name in FOLDERS:
        ignored = shutil.ignore_patterns("__pycache__", "build")
        shutil.copytree(ROOT / name, folder / name, ignore=ignored)
    for name in ("pyproject.toml", "README.md", "LICENSE", "CITATION.cff", "MANIFEST.in"):
        shutil.copyfile(ROOT / name, folder / name)
    return folder


@pytest.fixture(scope="module")
def wheel() -> Path:
    def build(folder: Path) -> None:
        pip("wheel", "--no-deps", "-w", folder, copy_sources(folder / "sources"))

    [file] = made_once("wheel", build).glob("*.whl")
    return file


class Environment:
    """A virtual environment without pip; the running interpreter's packages are found behind its own."""

    def __init__(self, folder: Path) -> None:
        venv.create(folder, with_pip=False, symlinks=os.name != "nt")
        programs = folder / ("Scripts" if os.name == "nt" else "bin")
        self.python, self.flexbeams = programs / "python", programs / "flexbeams"
        self.packages = Path(self.run("-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
        (self.packages / "behind.pth").write_text(sysconfig.get_path("purelib"))

    def run(self, *arguments: object, cwd: Path | None = None, **more: str) -> str:
        return run(self.python, *arguments, cwd=cwd, **more)

    def pip(self, verb: str, *arguments: object) -> None:
        pip("--python", self.python, verb, *arguments)

    def contents(self) -> dict[str, str]:
        """Files below site-packages, but compiled ones, and their digests."""
        files = (p for p in self.packages.rglob("*") if p.is_file() and p.suffix != ".pyc")
        return {str(p.relative_to(self.packages)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


@pytest.fixture
def environment(tmp_path: Path) -> Environment:
    return Environment(tmp_path / "environment")


def test_the_wheel_holds_one_package_and_all_of_it(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    assert {name.split("/")[0].split("-")[0] for name in names} == {"flexbeams"}
    expected = {
        (path if path.parts[0] == "flexbeams" else Path("flexbeams") / path).as_posix()
        for folder in FOLDERS
        for path in (p.relative_to(ROOT) for p in (ROOT / folder).rglob("*"))
        if path.name.endswith(SHIPPED) and not {"__pycache__", "build"} & set(path.parts)
    }
    assert expected - set(names) == set()
    assert "flexbeams/fmus/native/LICENSE" in names
    assert [name for name in names if name.endswith("licenses/scenarios/report/assets/uplot.LICENSE")]
    assert not [name for name in names if "test" in name]


def test_packages_with_names_of_our_folders_stay_as_they_are(
    wheel: Path, index: Path, environment: Environment
) -> None:
    """Installed beside them and uninstalled again."""
    environment.pip("install", "--no-deps", "--no-index", "--no-compile", "--find-links", index, *NAMESAKES)
    before = environment.contents()
    assert len(before) > 2 * len(NAMESAKES)
    environment.pip("install", "--no-deps", "--no-index", "--no-compile", wheel)
    beside = environment.contents()
    assert {name: beside.get(name) for name in before} == before
    assert {Path(name).parts[0].split("-")[0] for name in beside.keys() - before.keys()} == {"flexbeams"}
    assert environment.run(environment.flexbeams if os.name == "nt" else "-m", "flexbeams", "list")
    environment.pip("uninstall", "-y", "flexbeams")
    assert environment.contents() == before


SPAWNED = """
import multiprocessing, pickle
from flexbeams.plant.structure import find_structure, read_structure
if __name__ == "__main__":
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        structure = pool.apply(read_structure, (find_structure("kiel"),))
    assert pickle.loads(pickle.dumps(structure)) == read_structure(find_structure("kiel"))
    print(read_structure.__module__, len(structure.beam))
"""


def files_of_modules(environment: Environment, folder: Path, **more: str) -> list[Path]:
    """Where the modules of the package come from."""
    code = (
        "import json, sys, flexbeams.controller.design, flexbeams.fmus.packaging.build, flexbeams.scenarios.cli.main\n"
        "print(json.dumps([m.__file__ for n, m in sys.modules.items() if n.split('.')[0] == 'flexbeams']))"
    )
    return [Path(name).resolve() for name in json.loads(environment.run("-c", code, cwd=folder, **more))]


@pytest.mark.parametrize("mode", ["wheel", "default", "strict"])
def test_each_way_to_install_works(mode: str, wheel: Path, environment: Environment, tmp_path: Path) -> None:
    """From a wheel, or editable in setuptools' two modes: the command, a spawned process, pickles."""
    if mode == "wheel":
        environment.pip("install", "--no-deps", "--no-index", wheel)
    else:
        sources = copy_sources(tmp_path / "sources")
        settings = ["--config-settings", "editable_mode=strict"] if mode == "strict" else []
        environment.pip("install", "--no-deps", *settings, "-e", sources)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    assert "tracking" in run(environment.flexbeams, "list", cwd=elsewhere)
    (elsewhere / "script.py").write_text(SPAWNED)
    assert environment.run("script.py", cwd=elsewhere).split() == ["flexbeams.plant.structure", "3"]
    home = environment.packages if mode == "wheel" else tmp_path / "sources"
    assert all(path.is_relative_to(home.resolve()) for path in files_of_modules(environment, elsewhere))


def test_a_checkout_on_the_path_is_not_mixed_with_the_installed_package(
    wheel: Path, environment: Environment, tmp_path: Path
) -> None:
    environment.pip("install", "--no-deps", "--no-index", wheel)
    checkout = copy_sources(tmp_path / "checkout")
    files = files_of_modules(environment, tmp_path, PYTHONPATH=str(checkout))
    assert len(files) > 20
    assert all(path.is_relative_to(checkout.resolve()) for path in files)


def test_modules_of_the_user_hide_none_of_ours(tmp_path: Path) -> None:
    for name in (*NAMESAKES, "fmus"):
        (tmp_path / f"{name}.py").write_text("raise AssertionError('imported')\n")
    (tmp_path / "script.py").write_text("from flexbeams.scenarios.cli.main import main\nmain(['list'])\n")
    assert "tracking" in run(sys.executable, "script.py", cwd=tmp_path, **python_environment())


def test_the_package_is_light_to_import() -> None:
    """Nothing is loaded before it is used: of what `import flexbeams` adds, no module takes time."""
    code = "import sys; before = set(sys.modules); import flexbeams; print(*(set(sys.modules) - before))"
    added = set(run(sys.executable, "-c", code, **python_environment()).split())
    assert "flexbeams" in added
    assert not added & HEAVY
    assert not [name for name in added if name.startswith("flexbeams.")]
    version = run(sys.executable, "-c", "import flexbeams; print(flexbeams.__version__)", **python_environment())
    assert version.strip()[0].isdigit()


EVERY_VERB = """
import sys
from importlib.util import find_spec
from pathlib import Path

PLANT = 'title = "voltage"\\nstructure = "single_beam"\\nstop_time = 2.5\\n[instance.plant]\\nunit = "BeamPlant"\\n'
STEP = PLANT + '[[input]]\\nto = "plant.u"\\nstep = { time = 0.1, value = 300.0 }\\n'
BLOW = PLANT.replace("2.5", "0.5") + '''[instance.controller]
unit = "TrackingController"
[[connection]]
from = "controller.u"
to = "plant.u"
[[connection]]
from = "plant.y_pm"
to = "controller.y_pm"
[[input]]
to = "plant.force[1]"
pulse = { time = 0.1, duration = 5e-3, impulse = 0.01 }
'''
FORMATS = ",".join(["csv", "mat"] + [f for f, m in (("parquet", "pyarrow"), ("mf4", "asammdf")) if find_spec(m)])
CONTAINERS = ["container"] if find_spec("fmu_manipulation_toolbox") else []
SHORT = ["single_beam", "--stop-time", "0.5"]
PLAIN = ["--no-report", "--no-figures"]
EXPORTS = {"ssp": "loop.ssp", "ospsystem": "osp", "closed-loop": "loop.fmu", "container": "container.fmu"}
KNOWN = ["--known", "beam[1].density=7850", "--free", "beam[1].youngs_modulus"]
CALLS = [
    ["list"],
    ["show", "single_beam"],
    ["schema", "scenario"],
    ["new", "structure", "beam"],
    ["new", "scenario", "own"],
    ["new", "study", "many"],
    ["design", "--structure", "beam.toml", "--report", "design.html"],
    ["build", "BeamPlant", "--structure", "single_beam", "--backend", "all", "--out", "units"],
    ["run", *SHORT, "--out", "run", "--format", FORMATS],
    ["run", *SHORT, "--out", "other", "--coupling", "gauss-seidel", "--backend", "python", *PLAIN],
    ["compare", "run", "other/results.csv", "run/results.mat", "--out", "compared"],
    *[["export", *SHORT, "--format", f, "-o", EXPORTS[f]] for f in ("ssp", "ospsystem", "closed-loop", *CONTAINERS)],
    ["export", *SHORT, "--format", "wiring", "--wiring", "dymola", "-o", "wired"],
    ["run", "loop.ssp", "--out", "packaged"],
    ["validate", "loop.ssp", "loop.fmu", "units/native/BeamPlant.fmu"],
    ["run", "plant.toml", "--decimate", "25", "--out", "data", *PLAIN],
    ["identify", "data/results.csv", "--structure", "beam.toml", *KNOWN, "--out", "result.toml"],
    ["identify", "static", "data/results.csv", "--structure", "single_beam", "--out", "maps.csv"],
    ["tune", "blow.toml", "--out", "tuned", "--evaluations", "1", "--plants", "1"],
    ["study", "many.toml", "--runs", "2", "--jobs", "1"],
    ["bench", "--help"],  # compiles for a minute
    ["cache"],
]
if __name__ == "__main__":
    from flexbeams.fmus.packaging.compilers import Compiler
    from flexbeams.scenarios.cli.main import commands, main

    compile_anew, made = Compiler.make, {}

    def compile_once(compiler, out, options, definitions, includes, inputs, *more):  # the exports are of equal units
        files = [*(file for file in inputs if file != "-lm"), *sorted(out.parent.glob("*.h"))]
        key = (out.name, *(file.read_bytes() for file in files), repr((options, definitions, more)))
        if key not in made:
            compile_anew(compiler, out, options, definitions, includes, inputs, *more)
            made[key] = out.read_bytes()
        out.write_bytes(made[key])

    Compiler.make = compile_once
    Path("plant.toml").write_text(STEP)
    Path("blow.toml").write_text(BLOW)
    for call in CALLS:
        print("+", *call, flush=True)
        assert main(call) == 0, call
    assert {call[0] for call in CALLS} == set(commands.commands)
    own = [m for n, m in sys.modules.items() if n.split(".")[0] == "flexbeams"]
    assert all(Path(str(m.__file__)).is_relative_to(sys.prefix) for m in own), own
"""


@pytest.mark.native
@pytest.mark.timeout(600)
def test_every_verb_and_format_works_from_a_wheel(wheel: Path, environment: Environment, tmp_path: Path) -> None:
    """Without a checkout, in a folder that holds nothing else."""
    environment.pip("install", "--no-deps", "--no-index", wheel)
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "verbs.py").write_text(EVERY_VERB, encoding="utf-8")
    environment.run("verbs.py", cwd=folder, FLEXBEAMS_CACHE=str(tmp_path / "cache"), OPENBLAS_NUM_THREADS="1")
    written = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}
    assert {"run/results.mat", "run/report.html", "packaged/signals.png", "compared/compare.html"} <= written
    assert {"design.html", "tuned/tune.html", "identify.html", "maps.csv", "loop.fmu"} <= written


def test_older_versions_of_python_get_one_line() -> None:
    """Both modules that such a version reads are of its grammar; nothing else is imported."""
    for name in ("__init__", "__main__"):
        ast.parse((ROOT / f"flexbeams/{name}.py").read_text(encoding="utf-8"), feature_version=(3, 7))
    code = (
        "import sys; sys.version_info = (3, 10, 14, 'final', 0); from flexbeams.__main__ import main; sys.exit(main())"
    )
    done = subprocess.run([sys.executable, "-c", code], env=python_environment(), capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "flexbeams: needs Python 3.11 or newer, this is 3.10\n"
