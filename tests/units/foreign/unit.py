"""FMUs of the library foreign.c with any variables: the description is written here, without the project's own code."""

import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

from flexbeams.fmus.packaging.compilers import find_compiler, host_platform
from flexbeams.fmus.packaging.native import HEADERS
from tests.helpers import made_once

BASES = {
    "m": 'm="1"',
    "mm": 'm="1" factor="0.001"',
    "K": 'K="1"',
    "degC": 'K="1" offset="273.15"',
    "V": 'kg="1" m="2" s="-3" A="-1"',
}
ITEMS = ("off", "on", "auto")  # of every Enumeration, numbered from 1
LETTER = {"Real": "R", "Integer": "I", "Enumeration": "I", "Boolean": "B", "String": "S"}


def library() -> Path:
    """The compiled library."""

    def make(folder: Path) -> None:
        platform = host_platform()
        source = Path(__file__).with_name("foreign.c")
        find_compiler("zig").build(folder / f"foreign{platform.suffix}", [source], [HEADERS], platform)

    return made_once("foreign", make) / f"foreign{host_platform().suffix}"


@dataclass(frozen=True, kw_only=True)
class ForeignVariable:
    """A variable; `start` is text as the description has it."""

    name: str
    type: str
    causality: str
    reference: int
    start: str | None = None
    unit: str = ""
    attributes: str = ""  # further ones of its type


@dataclass(kw_only=True)
class ForeignUnit:
    """A unit: variables in the order of declaration, and what it does."""

    variables: list[ForeignVariable]
    rules: list[str] = field(default_factory=list)
    dependencies: dict[str, list[str]] | None = None  # inputs by output; None: not stated
    attributes: str = ""  # of CoSimulation
    name: str = "Foreign"
    step: str = "0.01"  # s, of the default experiment

    def description(self) -> str:
        """modelDescription.xml."""
        outputs = [v for v in self.variables if v.causality == "output"]
        place = {v.name: k for k, v in enumerate(self.variables, 1)}
        unknowns, initial = [], []
        for v in outputs:
            stated = "" if self.dependencies is None else self.dependencies.get(v.name, [])
            text = "" if self.dependencies is None else f' dependencies="{" ".join(str(place[n]) for n in stated)}"'
            unknowns.append(f'<Unknown index="{place[v.name]}"{text}/>')
            initial += unknowns[-1:] if v.start is None else []
        units = "".join(f'<Unit name="{n}"><BaseUnit {b}/></Unit>' for n, b in BASES.items())
        items = "".join(f'<Item name="{n}" value="{k}"/>' for k, n in enumerate(ITEMS, 1))
        mode = f'<SimpleType name="Mode"><Enumeration>{items}</Enumeration></SimpleType>'
        lists = f"<Outputs>{''.join(unknowns)}</Outputs>" if unknowns else ""
        lists += f"<InitialUnknowns>{''.join(initial)}</InitialUnknowns>" if initial else ""
        return (
            '<?xml version="1.0" encoding="UTF-8"?>'
            f'<fmiModelDescription fmiVersion="2.0" modelName="{self.name}" guid="{{foreign}}">'
            f'<CoSimulation modelIdentifier="foreign" canHandleVariableCommunicationStepSize="true" {self.attributes}/>'
            f"<UnitDefinitions>{units}</UnitDefinitions>"
            f"<TypeDefinitions>{mode}</TypeDefinitions>"
            f'<DefaultExperiment startTime="0" stopTime="1" stepSize="{self.step}"/>'
            f"<ModelVariables>{''.join(map(_element, self.variables))}</ModelVariables>"
            f"<ModelStructure>{lists}</ModelStructure></fmiModelDescription>"
        )

    def write(self, path: Path, **entries: bytes) -> Path:
        """Writes the FMU; further entries by path, with __ for the folder's slash."""
        platform = host_platform()
        starts = [f"start {LETTER[v.type]} {v.reference} {_plain(v)}" for v in self.variables if v.start is not None]
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("modelDescription.xml", self.description())
            archive.write(library(), f"binaries/{platform.name}/foreign{platform.suffix}")
            archive.writestr("resources/rules.txt", "\n".join([*starts, *self.rules]) + "\n")
            for name, content in entries.items():
                archive.writestr(name.replace("__", "/"), content)
        return path


def _plain(variable: ForeignVariable) -> str:
    text = str(variable.start)
    return {"true": "1", "false": "0"}.get(text, text) if variable.type == "Boolean" else text


def _element(v: ForeignVariable) -> str:
    variability = "fixed" if v.causality == "parameter" else "continuous" if v.type == "Real" else "discrete"
    exact = ' initial="exact"' if v.causality == "output" and v.start is not None else ""
    start = "" if v.start is None else f" start={quoteattr(v.start)}"
    unit = f' unit="{v.unit}"' if v.unit else ""
    declared = ' declaredType="Mode"' if v.type == "Enumeration" else ""
    return (
        f'<ScalarVariable name={quoteattr(v.name)} valueReference="{v.reference}" causality="{v.causality}" '
        f'variability="{variability}"{exact}><{v.type}{declared}{start}{unit} {v.attributes}/></ScalarVariable>'
    )
