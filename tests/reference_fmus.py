"""Reference-FMUs of FMI 2.0, built from their public sources, validated and run beside their published results.

    git clone https://github.com/modelica/Reference-FMUs
    python -m tests.reference_fmus Reference-FMUs

Not among the usual tests, since it needs the sources. Prints a line for each unit; the exit status is 1 where a unit is
not valid or its results differ.
"""

import csv
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
from fmpy import read_model_description

from flexbeams.fmus.packaging.cache import cache_folder
from flexbeams.fmus.packaging.compilers import find_compiler, host_platform
from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.runs.observer import Observer
from flexbeams.scenarios.runs.scenario import run_scenario
from flexbeams.scenarios.validation.package import unit_problems
from flexbeams.scenarios.validation.references import reference_checks

MODELS = ("BouncingBall", "Dahlquist", "Feedthrough", "Resource", "Stair", "VanDerPol")
TOLERANCE = 1e-9  # of the largest value of a signal
STEPS = {"Feedthrough": 0.1, "Resource": 0.1}  # s, of units without a step of their own
DRIVEN = {  # inputs of Feedthrough with values of each type
    "Float64_continuous_input": 1.5,
    "Float64_discrete_input": -2.25,
    "Int32_input": -2147483648,
    "Boolean_input": 1,
    "Enumeration_input": 2,
}


def build(sources: Path, model: str, folder: Path) -> Path:
    """The FMU of a model, with the files that the project's own build puts into it."""
    platform = host_platform()
    library = folder / f"{model}{platform.suffix}"
    files = [sources / model / "model.c", sources / "src/fmi2Functions.c", sources / "src/cosimulation.c"]
    includes = [sources / "include", sources / model]
    find_compiler("zig").build(library, files, includes, platform, ("FMI_VERSION=2", "DISABLE_PREFIX", "_GNU_SOURCE"))
    references = "extra/org.fmi-standard.fmi-ls-ref"
    path = folder / f"{model}.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(sources / model / "FMI2.xml", "modelDescription.xml")
        archive.write(library, f"binaries/{platform.name}/{model}{platform.suffix}")
        if model != "Feedthrough":  # whose published results have columns of FMI 3.0
            archive.write(sources / model / "fmi-ls-ref.xml", f"{references}/fmi-ls-manifest.xml")
            archive.write(sources / model / f"{model}_out.csv", f"{references}/{model}_out.csv")
        if model == "Resource":
            archive.write(sources / model / "y.txt", "resources/y.txt")
    return path


def run(fmu: Path, settings: Settings, notes: list[str], inputs: dict[str, float]) -> dict[str, Array]:
    """The recorded signals of a unit's default experiment by name, and `time`."""
    experiment = read_model_description(str(fmu), validate=False).defaultExperiment
    step = float(experiment.stepSize or STEPS[fmu.stem])
    text = f'title = "{fmu.stem}"\nstructure = "single_beam"\nstop_time = {float(experiment.stopTime)}\nstep = {step}\n'
    text += f'[instance.unit]\nfmu = "{fmu.name}"\n'
    text += "".join(f'[[input]]\nto = "unit.{name}"\nconstant = {float(value)}\n' for name, value in inputs.items())
    path = fmu.with_suffix(".toml")
    path.write_text(text)
    recording = run_scenario(path, settings, Observer(notify=notes.append)).recording
    if recording.failure is not None:
        raise recording.failure
    names = [column.removeprefix("unit.") for column in recording.columns]
    return {"time": recording.time, **dict(zip(names, recording.values.T, strict=True))}


def deviation(signals: dict[str, Array], published: Path) -> tuple[int, float]:
    """How many values are compared, and the largest difference relative to the largest value of a signal."""
    with published.open(newline="") as file:
        rows = list(csv.DictReader(file))
    time = np.array([float(row["time"]) for row in rows])
    places = np.searchsorted(signals["time"], time - 1e-9)
    met = (places < len(signals["time"])) & (
        np.abs(signals["time"][np.minimum(places, len(signals["time"]) - 1)] - time) < 1e-9
    )
    count, worst = 0, 0.0
    for name in sorted(signals.keys() & rows[0].keys() - {"time"}):
        values = np.array([float({"true": "1", "false": "0"}.get(row[name], row[name])) for row in rows])
        difference = np.abs(signals[name][places[met]] - values[met]).max(initial=0.0)
        count, worst = count + int(met.sum()), max(worst, float(difference / (np.abs(values).max() or 1.0)))
    return count, worst


def main(sources: Path) -> int:
    """Builds, validates and runs all units; the exit status."""
    failures = 0
    settings = Settings(build_folder=cache_folder(None), record_animation=False)
    with tempfile.TemporaryDirectory(prefix="flexbeams_") as temporary:
        for model in MODELS:
            fmu, notes = build(sources, model, Path(temporary)), list[str]()
            problems = unit_problems(fmu)
            checks = reference_checks(fmu)
            count, worst = deviation(run(fmu, settings, notes, {}), sources / model / f"{model}_out.csv")
            good = not problems and all(check.passed for check in checks) and count > 0 and worst <= TOLERANCE
            if model == "Feedthrough":
                driven = run(fmu, settings, notes, DRIVEN)
                wrong = [n for n, v in DRIVEN.items() if driven[n.replace("_input", "_output")][-1] != v]
                good, problems = good and not wrong, [*problems, *(f"{n} is not passed on" for n in wrong)]
            failures += not good
            print(f"{model}: {'good' if good else 'BAD'}, {count} values within {worst:.1g}")
            for text in (*problems, *(check.message for check in checks), *notes):
                print(f"  {text}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
