"""Longest fmi2DoStep of FlatnessFeedforward with new targets near the limit: `python -m tests.planning_times`.

A new random target every 50 ms. Processor time of the thread for each step, the least of several equal runs, since
other processes disturb single steps; all runs, and one in steps of 10 ms, must have the same plans.
"""

import argparse
import tempfile
import time
from ctypes import c_double, c_uint
from pathlib import Path

import fmpy
import numpy as np

from flexbeams.controller.design import compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.scenarios.api.units import build
from tests.oracles.chains import chain_of_beams
from tests.units.loaded import Loaded, Real, loaded

STEP, EVERY = 2e-4, 250  # s; steps between targets


def course(unit: Loaded, targets: Real, requested: float, size: int) -> tuple[Real, Real]:
    """Times of the steps (k,), s, in steps of `size` samples, and planned_time, planned_peak before each target."""
    unit.begin(transition_time=requested)
    library, component = unit._fmu.dll, unit._fmu.component
    names = unit._elements("y_target")
    references = (c_uint * len(names))(*(unit.variables[name].valueReference for name in names))
    times, plans, count = [], [], 0
    for target in targets:
        assert library.fmi2SetReal(component, references, len(names), (c_double * len(names))(*target)) == 0
        for _ in range(EVERY // size):
            begin = time.thread_time_ns()
            status = library.fmi2DoStep(component, c_double(count * STEP), c_double(size * STEP), 1)
            times.append(1e-9 * (time.thread_time_ns() - begin))
            assert status < 2
            count += size
        plans.append(unit.take("planned_time", "planned_peak"))
    return np.array(times), np.array(plans)


def main() -> None:
    """Prints median, 99.9 % and largest of the steps in microseconds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--beams", type=int, default=3)
    parser.add_argument("--planner", default="paper", choices=["paper", "multi_input"])
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    design = compute_design(chain_of_beams(options.beams), DesignOptions(planner=options.planner, verify="design"))
    inverse = design.arrays["static_inverse"]
    voltages = np.random.default_rng(7).uniform(-990, 990, (options.steps // EVERY, len(inverse)))
    targets = voltages @ np.linalg.pinv(inverse).T
    targets *= np.minimum(1.0, 995 / np.abs(targets @ inverse.T).max(axis=1))[:, None]
    requested = 0.1 if options.planner == "paper" else 0.3
    with tempfile.TemporaryDirectory() as folder:
        [file] = build(design, ["FlatnessFeedforward"], folder=Path(folder))
        with loaded(Path(fmpy.extract(str(file), unzipdir=str(Path(folder) / "unit")))) as unit:
            runs = []
            for size in [1] * options.repeats + [50]:
                runs.append(course(unit, targets, requested, size))
                unit.call("reset")
    assert all(np.array_equal(plans, runs[0][1]) for _, plans in runs)
    least = 1e6 * np.min([times for times, _ in runs[:-1]], axis=0)
    median, most = np.quantile(least, (0.5, 0.999))
    different = len(np.unique(runs[0][1][:, 1]))
    print(f"{options.beams} beams, {options.planner}: {len(least)} steps, {different} plans")
    print(f"median {median:.1f}, 99.9 % {most:.1f}, largest {least.max():.1f} microseconds")


if __name__ == "__main__":
    main()
