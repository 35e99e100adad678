"""The file of a design: a NumPy archive of its arrays and a JSON text."""

import json
from pathlib import Path

import numpy as np

from flexbeams.controller.design import FORMAT, Design, identify, meta_text
from flexbeams.controller.options import DesignOptions
from flexbeams.plant.archive import npz_bytes, read_arrays, write_whole
from flexbeams.plant.errors import InputError
from flexbeams.plant.structure import Structure
from flexbeams.plant.validation import validate


def write_design(design: Design, path: Path) -> None:
    """Writes the design file: the arrays and the text `meta`; the same design gives the same bytes."""
    meta = np.array(meta_text(design.structure, design.options, summary=design.summary, design_id=design.design_id))
    write_whole(path, npz_bytes({**design.arrays, "meta": meta}))


def read_design(path: Path) -> Design:
    """The design in a file; InputError where it is not a design file of this format or was altered."""
    arrays, source = read_arrays(path), str(path)
    try:
        meta = json.loads(str(arrays.pop("meta")))
        file_format, structure, options, summary, design_id = (
            meta[key] for key in ("format", "structure", "options", "summary", "design_id")
        )
    except (KeyError, TypeError, json.JSONDecodeError):
        raise InputError("", "is not a flexbeams design file", source=source) from None
    if file_format != FORMAT:
        raise InputError("format", f"must be {FORMAT}; make the design again", file_format, source=source)
    design = identify(validate(Structure, structure, source), validate(DesignOptions, options, source), summary, arrays)
    if design.design_id != design_id:
        raise InputError(
            "design_id",
            f"must be {design.design_id}, the hash of the contents: the file was altered",
            design_id,
            source=source,
        )
    return design
