"""Finished designs in the user's cache, beside the units that are built from them."""

import hashlib
import json
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.design_file import read_design, write_design
from flexbeams.controller.options import DesignOptions
from flexbeams.fmus.packaging.cache import is_sound, prepare_folder, record
from flexbeams.fmus.packaging.sources import sources_digest
from flexbeams.plant.errors import InputError
from flexbeams.plant.structure import Structure
from flexbeams.plant.versions import installed_version

FOLDER = "designs"


def cached_design(structure: Structure, options: DesignOptions, root: Path) -> Design:
    """The design of `compute_design`, from the cache `root` where it was computed before, bit by bit the same.

    A file that is missing, damaged or of other sources is made again; where the cache cannot be used, the design is
    computed. Raises DesignError as compute_design does.
    """
    file = root / FOLDER / f"{_key(structure, options)}.npz"
    if is_sound(file, root):
        with suppress(InputError):  # of another version
            return read_design(file)
    design = compute_design(structure, options)
    with suppress(InputError, OSError):
        prepare_folder(file.parent, root)
        write_design(design, file)
        record(file)
    return design


def _key(structure: Structure, options: DesignOptions) -> str:
    """Hash of all that a design depends on: a file of static maps by its contents."""
    text = json.dumps({"structure": asdict(structure), "options": asdict(options)}, sort_keys=True)
    digest = hashlib.sha256(text.encode())
    for part in (sources_digest("plant", "controller"), installed_version("numpy"), installed_version("scipy")):
        digest.update(part.encode())
    if Path(options.static_maps).is_file():
        digest.update(Path(options.static_maps).read_bytes())
    return digest.hexdigest()[:32]
