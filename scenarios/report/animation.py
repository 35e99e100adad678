"""Data of the animated beams: geometry, shapes, voltages, and the reference shape as a ghost."""

from typing import Any

from flexbeams.controller.design import Design
from flexbeams.plant.galerkin import STATIONS
from flexbeams.scenarios.report.page import int16
from flexbeams.scenarios.simulation.frames import Frames


def animation(frames: Frames | None, design: Design, step: float) -> dict[str, Any] | None:
    """Input of animation.js; None without recorded shapes of the design's structure.

    The ghost is w = H_w x_ref + D_w u_ff, the shape of the reduced model under the feedforward.
    """
    structure, arrays = design.structure, design.arrays
    if frames is None or frames.deflections.shape[1] != len(structure.beam) * STATIONS or len(frames.values) < 2:
        return None
    x_ref, u_ff = frames.reference
    ghost = None
    if x_ref.shape[1] == arrays["H_w"].shape[1]:
        ghost = int16(x_ref @ arrays["H_w"].T + u_ff @ arrays["D_w"].T)
    return {
        "interval": frames.every * step,
        "frames": len(frames.values),
        "stations": STATIONS,
        "shapes": int16(frames.deflections),
        "ghost": ghost,
        "voltages": int16(frames.voltages),
        "beams": [{"length": b.length, "width": b.width, "mass": b.tip_mass} for b in structure.beam],
        "patches": [{"beam": p.beam - 1, "start": p.position, "end": p.end, "width": p.width} for p in structure.patch],
        "springs": [sorted(b - 1 for b in s.between) for s in structure.spring],
        "points": [{"beam": p.beam - 1, "position": p.position} for p in structure.point_of_interest],
    }
