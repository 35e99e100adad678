"""Shared library of an extracted FMI 2.0 unit for this machine.

FMI 2.0's own folders (linux64, win64, darwin64) name no CPU: on an ARM machine FMPy finds the binary for x86_64 there.
FMI 2.0.4 adds the folders of FMI 3.0, named after CPU and system, which are preferred here.
"""

from pathlib import Path

import fmpy

from flexbeams.plant.errors import InputError


def library_file(folder: Path, identifier: str) -> Path:
    """Path of the library of a unit in `folder` by its modelIdentifier.

    InputError where there is none for this machine; it names the folders with binaries.
    """
    folders, name = (fmpy.platform_tuple, fmpy.platform), f"{identifier}{fmpy.sharedLibraryExtension}"
    for platform in folders:
        file: Path = folder.absolute() / "binaries" / platform / name
        if file.is_file():
            return file
    present = ", ".join(sorted(path.name for path in (folder / "binaries").glob("*") if path.is_dir()))
    places = " or ".join(f"binaries/{platform}" for platform in folders)
    raise InputError("", f"has no {name} in {places}; its binaries are for {present or 'no platform'}")
