"""A finished design and its identity."""

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Any

from flexbeams.controller.options import DesignOptions
from flexbeams.plant.archive import array_bytes
from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BasisName
from flexbeams.plant.galerkin import BeamModel, beam_model
from flexbeams.plant.structure import Structure

METHOD = 2  # version of the method; raised by every change that changes a design beyond rounding

_OWN_LIMITS = ("voltage_min", "voltage_max")  # count where they are given: designs without them keep their ids


@dataclass(frozen=True, kw_only=True)
class Design:
    """A finished design. Shapes: m = 2 r N_r states, n_u inputs, n_pi points, n_pm gauges."""

    structure: Structure
    options: DesignOptions
    summary: dict[str, Any]  # figures for people and for --json
    arrays: dict[str, Array]  # the numbers that the units compute with, by name; see compute_design
    design_id: str  # see identify

    @property
    def integral_gain(self) -> float:
        """k_I of (45) at the sample time of the design."""
        return float(self.summary["integral_gain"])

    @property
    def integral_gain_limit(self) -> float:
        """Largest k_I for which the closed loop is stable."""
        return float(self.summary["integral_gain_limit"])

    def model(self, basis: BasisName | None = None, order: int | None = None) -> BeamModel:
        """The plant's model: of the design's own basis, or another one of the same structure."""
        if basis is None or basis == self.options.basis:
            return beam_model(self.structure, self.options.basis, order or self.options.order)
        return beam_model(self.structure, basis, order)


def identify(
    structure: Structure, options: DesignOptions, arrays: dict[str, Array], with_fingerprint: bool = False
) -> str:
    """The design_id: a hash of structure, options and METHOD, equal on every machine.

    Designs with equal ids fit each other: their arrays agree to about 1e-9. Where the truncation separates nearly
    equal singular values they do not, and a fingerprint of `arrays` follows the hash. Static maps from a file count by
    their contents.
    """
    choices = {
        name: choice for name, choice in asdict(options).items() if name not in _OWN_LIMITS or choice is not None
    }
    if options.static_maps not in ("basis", "segment"):
        choices["static_maps"] = fingerprint({name: arrays[name] for name in ("D_pi", "D_pm", "static_inverse")})
    parts = asdict(structure)
    del parts["actuator"]  # which a design does not depend on
    text = json.dumps({"method": METHOD, "structure": parts, "options": choices}, sort_keys=True)
    name = hashlib.sha256(text.encode()).hexdigest()[:32]
    return f"{name}-{fingerprint(arrays)[:8]}" if with_fingerprint else name


def fingerprint(arrays: dict[str, Array]) -> str:
    """Hash of every array's bytes: different where a linear algebra library rounds differently."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(name.encode())
        digest.update(array_bytes(arrays[name]))
    return digest.hexdigest()
