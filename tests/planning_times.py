"""Longest fmi2DoStep of FlatnessFeedforward with new targets near the limit: `python -m tests.planning_times`.

A new random target every 50 ms. Processor time of the thread for each step, the least of several equal runs, since
other processes disturb single steps; all runs, and one in steps of 10 ms, must have the same plans. With
`--instructions` those of each step are counted by valgrind instead, which nothing disturbs.
"""

import argparse
import subprocess
import tempfile
import time
from ctypes import c_double
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fmpy
import numpy as np

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.fmus.packaging.native import compiled_file, unit_sources
from flexbeams.scenarios.api.units import build
from tests.native.workshop import HARNESSES, INCLUDES, ZIG, native_unit, run
from tests.oracles.chains import chain_of_beams
from tests.units.loaded import Loaded, Real, loaded

STEP, EVERY = 2e-4, 250  # s; steps between targets
UNIT = "FlatnessFeedforward"


def course(unit: Loaded, targets: Real, requested: float, size: int) -> tuple[Real, Real]:
    """Times of the steps (k,), s, in steps of `size` samples, and planned_time, planned_peak before each target."""
    unit.begin(transition_time=requested)
    library, component = unit._fmu.dll, unit._fmu.component
    times, plans, count = [], [], 0
    for target in targets:
        unit.put("y_target", target)
        for _ in range(EVERY // size):
            begin = time.thread_time_ns()
            status = library.fmi2DoStep(component, c_double(count * STEP), c_double(size * STEP), 1)
            times.append(1e-9 * (time.thread_time_ns() - begin))
            assert status < 2
            count += size
        plans.append(unit.take("planned_time", "planned_peak"))
    return np.array(times), np.array(plans)


def instructions(design: Design, targets: Real, requested: float, folder: Path) -> Real:
    """Instructions of the steps (k,), without those of the C library's set-up: needs valgrind."""
    files, description = unit_sources(native_unit(UNIT, design, folder))
    for name, content in files.items():
        (folder / name).write_bytes(content)
    model = ElementTree.fromstring(description)
    references = {v.get("name"): v.get("valueReference", "") for v in model.iter("ScalarVariable")}
    program, counts = folder / "retargeting", folder / "counts"
    names = [f'-DUNIT_GUID="{model.get("guid")}"', "-DFMI2_OVERRIDE_FUNCTION_PREFIX"]
    sources = [str(folder / compiled_file(UNIT)), str(HARNESSES / "retargeting.c")]
    flags = ["-std=c99", "-O2", "-mcpu=baseline", "-ffp-contract=off", *names, *INCLUDES, f"-I{folder}"]
    run([*ZIG, *flags, *sources, "-o", str(program), "-lm"])
    ends = ["--toggle-collect=fmi2DoStep", "--zero-before=fmi2DoStep", "--dump-after=fmi2DoStep", "--dump-line=no"]
    counting = ["valgrind", "-q", "--tool=callgrind", *ends, "--combine-dumps=yes", f"--callgrind-out-file={counts}"]
    arguments = [references["y_target[1]"], targets.shape[1], references["transition_time"], requested, EVERY, STEP]
    subprocess.run([*counting, str(program), *map(str, arguments)], input=targets.tobytes(), check=True)
    with counts.open() as lines:
        totals = [int(line.split()[1]) for line in lines if line.startswith("totals:")]
    return np.array(totals[: len(targets) * EVERY], dtype=float)


def timed(design: Design, targets: Real, requested: float, folder: Path, repeats: int) -> tuple[Real, int]:
    """Microseconds of the steps (k,), the least of some runs, and how many plans differ from each other."""
    [file] = build(design, [UNIT], folder=folder)
    runs = []
    with loaded(Path(fmpy.extract(str(file), unzipdir=str(folder / "unit")))) as unit:
        for size in [1] * repeats + [50]:
            runs.append(course(unit, targets, requested, size))
            unit.call("reset")
    assert all(np.array_equal(plans, runs[0][1]) for _, plans in runs)
    return 1e6 * np.min([times for times, _ in runs[:-1]], axis=0), len(np.unique(runs[0][1][:, 1]))


def random_targets(inverse: Real, count: int) -> Real:
    """Targets (count, points), m, that take up to 995 V at rest."""
    voltages = np.random.default_rng(7).uniform(-990, 990, (count, len(inverse)))
    targets = voltages @ np.linalg.pinv(inverse).T
    reachable: Real = targets * np.minimum(1.0, 995 / np.abs(targets @ inverse.T).max(axis=1))[:, None]
    return reachable


def shown(values: Real) -> str:
    """Median, 99.9 % and largest."""
    return "median {:.1f}, 99.9 % {:.1f}, largest {:.1f}".format(*np.quantile(values, (0.5, 0.999, 1.0)))


def main() -> None:
    """Prints median, 99.9 % and largest of the steps in microseconds, or in thousands of instructions."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--beams", type=int, default=3)
    parser.add_argument("--planner", default="paper", choices=["paper", "multi_input"])
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--instructions", action="store_true")
    options: Any = parser.parse_args()
    design = compute_design(chain_of_beams(options.beams), DesignOptions(planner=options.planner, verify="design"))
    targets = random_targets(design.arrays["static_inverse"], options.steps // EVERY)
    requested = 0.1 if options.planner == "paper" else 0.3
    print(f"{options.beams} beams, {options.planner}: {len(targets) * EVERY} steps")
    with tempfile.TemporaryDirectory() as folder:
        if options.instructions:
            counts = instructions(design, targets, requested, Path(folder))
            print(f"{shown(1e-3 * counts)} thousand instructions")
            return
        times, different = timed(design, targets, requested, Path(folder), options.repeats)
    print(f"{different} plans; {shown(times)} microseconds")


if __name__ == "__main__":
    main()
