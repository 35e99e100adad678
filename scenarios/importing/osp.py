"""OspSystemStructure.xml of the Open Simulation Platform: stop time, step and simulators."""

from dataclasses import dataclass
from pathlib import Path

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.importing.xml_reading import read_document

OSP_STRUCTURE = "http://opensimulationplatform.com/MSMI/OSPSystemStructure"


@dataclass(frozen=True, kw_only=True)
class OspSystem:
    """A system structure; None where it is silent."""

    simulators: dict[str, Path]  # FMU by name
    stop_time: float | None  # s
    step: float | None  # s


def read_osp(file: Path) -> OspSystem:
    """Reads an OspSystemStructure.xml; InputError for anything else."""
    try:
        root = read_document(file.read_bytes(), "")
    except (OSError, InputError) as error:
        raise InputError("", f"must be an SSP package or OspSystemStructure.xml: {error}", source=str(file)) from None
    if root.tag != f"{{{OSP_STRUCTURE}}}OspSystemStructure":
        raise InputError("", "must be an SSP package or OspSystemStructure.xml", root.tag, source=str(file))

    def number(key: str) -> float | None:
        text = root.findtext(f"{{{OSP_STRUCTURE}}}{key}")
        try:
            return None if text is None else float(text)
        except ValueError:
            raise InputError(key, "must be a number", text, source=str(file)) from None

    simulators = root.iter(f"{{{OSP_STRUCTURE}}}Simulator")
    return OspSystem(
        simulators={str(s.get("name")): file.parent / str(s.get("source")) for s in simulators},
        stop_time=number("EndTime"),
        step=number("BaseStepSize"),
    )
