"""Descriptions of FMUs: from sound archives, of FMI 2.0 for co-simulation."""

import io
import zipfile
from pathlib import Path
from typing import Any

from fmpy import read_model_description

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.importing.archives import ExtractionBudget
from flexbeams.scenarios.importing.xml_reading import read_document


def unit_description(file: Path, key: str, source: str) -> Any:
    """FMPy's description of an FMI 2.0 co-simulation unit; InputError for anything else.

    `key` and `source` name the file in errors.
    """
    try:
        ExtractionBudget().check(file)
        with zipfile.ZipFile(file) as archive:
            content = archive.read("modelDescription.xml")
        root = read_document(content, "modelDescription.xml")
    except InputError as error:
        text = str(error).removeprefix(f"{file}: ")
        raise InputError(key, f"must be an FMU ({text})", str(file), source=source) from None
    except (KeyError, OSError, zipfile.BadZipFile) as error:
        raise InputError(
            key, f"must be an FMU ({error.args[0] if error.args else error})", str(file), source=source
        ) from None
    if (version := root.get("fmiVersion")) != "2.0" or root.find("CoSimulation") is None:
        other = f", not of FMI {version}" if version != "2.0" else ", not for model exchange"
        raise InputError(key, f"must be an FMI 2.0 co-simulation unit{other}", str(file), source=source)
    try:
        stored = io.BytesIO()
        with zipfile.ZipFile(stored, "w") as archive:
            archive.writestr("modelDescription.xml", content)
        return read_model_description(stored, validate=False)
    except Exception as error:  # FMPy raises various errors on a damaged description
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise InputError(key, f"must be an FMU ({reason})", str(file), source=source) from None
