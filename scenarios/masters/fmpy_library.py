"""Libraries for this CPU under tools that load units by FMPy."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fmpy import fmi1

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.importing.library import library_file
from flexbeams.scenarios.masters.trace import Fault

FOLDER_WITHOUT_CPU = Fault(
    name="folder without CPU",
    description="FMI 2.0 binaries are loaded from linux64 and darwin64 whatever the CPU.",
    remedy="FMPy gets the path of the library for this one.",
)


@contextmanager
def library_for_this_cpu() -> Iterator[None]:
    """Passes FMPy the path of each library that it would look for itself."""
    original = fmi1._FMU.__init__

    def initialise(unit: Any, *arguments: Any, **options: Any) -> None:
        if not arguments and options.get("libraryPath") is None:
            try:
                file = library_file(Path(options["unzipDirectory"]), options["modelIdentifier"])
            except InputError:
                pass  # FMPy reports the folder
            else:
                options["libraryPath"] = str(file)
        original(unit, *arguments, **options)

    fmi1._FMU.__init__ = initialise
    try:
        yield
    finally:
        fmi1._FMU.__init__ = original
