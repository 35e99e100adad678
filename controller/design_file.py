"""The file of a design: a NumPy archive of its arrays and a JSON text."""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.controller.design_record import METHOD, Design, fingerprint
from flexbeams.controller.options import DesignOptions
from flexbeams.plant.archive import npz_bytes, read_arrays, write_whole
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.plant.structure import Structure
from flexbeams.plant.validation import validate

FORMAT = 3
_KEYS = {"format", "method", "structure", "options", "summary", "design_id", "checksum"}


def write_design(design: Design, path: Path) -> None:
    """Writes the design file: the arrays and the text `meta`; the same design gives the same bytes."""
    meta = {
        "format": FORMAT,
        "method": METHOD,
        "structure": asdict(design.structure),
        "options": asdict(design.options),
        "summary": design.summary,
        "design_id": design.design_id,
    }
    meta["checksum"] = _checksum(meta, design.arrays)
    text = np.array(json.dumps(meta, sort_keys=True))
    write_whole(path, npz_bytes({**design.arrays, "meta": text}))


def _checksum(meta: dict[str, Any], arrays: dict[str, Array]) -> str:
    """Hash of everything in the file except the checksum itself."""
    text = json.dumps({key: value for key, value in meta.items() if key != "checksum"}, sort_keys=True)
    return hashlib.sha256((text + fingerprint(arrays)).encode()).hexdigest()


def read_design(path: Path) -> Design:
    """The design in a file; InputError where it is not a design file of this format or was altered."""
    arrays, source = read_arrays(path), str(path)
    try:
        meta = json.loads(str(arrays.pop("meta")))
        complete = meta.keys() >= _KEYS
    except (KeyError, TypeError, AttributeError, json.JSONDecodeError):
        complete = False
    if not complete:
        raise InputError("", "is not a flexbeams design file", source=source)
    for key, current in (("format", FORMAT), ("method", METHOD)):
        if meta[key] != current:
            raise InputError(key, f"must be {current}; make the design again", meta[key], source=source)
    if meta["checksum"] != _checksum(meta, arrays):
        raise InputError("checksum", "must be the hash of the contents: the file was altered", source=source)
    return Design(
        structure=validate(Structure, meta["structure"], source),
        options=validate(DesignOptions, meta["options"], source),
        summary=meta["summary"],
        arrays=arrays,
        design_id=meta["design_id"],
    )
