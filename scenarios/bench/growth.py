"""Costs of plant and controller as the number of beams grows."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from flexbeams.controller.design import compute_design
from flexbeams.fmus.units.beam_plant import BEAM_PLANT
from flexbeams.fmus.units.tracking_controller import TRACKING_CONTROLLER
from flexbeams.plant.structure import Spring, Structure, find_structure, read_structure
from flexbeams.scenarios.bench.arithmetic import matrices_of
from flexbeams.scenarios.bench.loop_costs import from_rest
from flexbeams.scenarios.bench.timing import bare_and_fmi, interleaved
from flexbeams.scenarios.bench.workbench import Workbench

BEAMS = (1, 2, 3, 5, 10, 20)
STEPS = 1_000  # at most


def measure_growth(bench: Workbench, rounds: int, beams: int) -> dict[str, Any]:
    """Plant and controller of a row of beams, with default options of the design."""
    structure = repeat_beams(read_structure(find_structure("kiel")), beams)
    design = compute_design(structure)
    model = design.model()
    files = bench.units({"plant": (BEAM_PLANT, model), "controller": (TRACKING_CONTROLLER, model)}, design)
    matrices = matrices_of(design, model)
    bare = bench.bare(matrices=matrices)
    steps = min(bench.steps, STEPS)
    random = np.random.default_rng(beams)
    result: dict[str, Any] = {
        "beams": beams,
        "states": len(matrices.transition),
        "reduced_modes": design.options.reduced_modes,
        "reduced_states": len(matrices.filter),
        "inputs": len(structure.patch),
        "steps": steps,
    }
    n_u, n = len(structure.patch), len(matrices.filter)
    for unit, arrays, width, call in (
        ("plant", ("u", "force"), n_u + beams, bare.plant),
        ("controller", ("u_ff", "x_ref", "y_pm"), n_u + n + len(structure.strain_gauge), bare.controller),
    ):
        scale = np.r_[np.full(n_u, 10.0), np.full(width - n_u, 1e-6)]
        rows = random.normal(size=(steps, width)) * scale
        loop = bench.file_loop(files[unit], arrays, rows, folder=str(beams))
        times = interleaved(
            {"bare": from_rest(bare, partial(call, rows)), "fmi": partial(loop.advance_from_start, rows)}, rounds
        )
        result[unit] = bare_and_fmi(times, steps)
    return result


def repeat_beams(structure: Structure, beams: int) -> Structure:
    """A row of `beams` beams, equipped as those of a structure of three, with springs between neighbours."""
    count = len(structure.beam)

    def copied(parts: Sequence[Any]) -> list[Any]:
        return [replace(part, beam=k + 1) for k in range(beams) for part in parts if part.beam == k % count + 1]

    return Structure(
        beam=[structure.beam[k % count] for k in range(beams)],
        patch=copied(structure.patch),
        spring=[
            Spring(between=(k + 1, k + 2), stiffness=structure.spring[k % len(structure.spring)].stiffness)
            for k in range(beams - 1)
        ],
        point_of_interest=copied(structure.point_of_interest),
        strain_gauge=copied(structure.strain_gauge),
    )
