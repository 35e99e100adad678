"""A scenario's closed loop as one FMI 2.0 unit that holds its units unchanged, run by FMUContainer inside.

FMUContainer is part of fmu-manipulation-toolbox: a C library without threads of its own (as it is set up here) that
steps units under Jacobi or Gauss-Seidel coupling with the results of this package's runner, to the last bit.
"""

import logging
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from html import escape
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from xml.etree import ElementTree

from flexbeams.fmus.documents.closed_loop_page import loop_picture
from flexbeams.fmus.documents.description import content_guid, model_description
from flexbeams.fmus.documents.documentation import html_page, table
from flexbeams.fmus.documents.picture import array_labels
from flexbeams.fmus.documents.terminals import PATH as TERMINALS
from flexbeams.fmus.documents.terminals import terminals_document
from flexbeams.fmus.documents.xml_documents import xml_bytes
from flexbeams.fmus.errors import BuildError, InterfaceError
from flexbeams.fmus.interface.variables import TIME, Interface, Variable
from flexbeams.fmus.packaging.compilers import Platform, chosen_platforms
from flexbeams.fmus.units.closed_loop import without_parts
from flexbeams.plant.archive import write_whole, zip_bytes
from flexbeams.plant.errors import InputError
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.exporting.container_parts import FOLDERS, Part, build_parts
from flexbeams.scenarios.exporting.exportable import require_exportable
from flexbeams.scenarios.runs.prepare import PreparedScenario, prepare_scenario

PACKAGE = "fmu-manipulation-toolbox"
MIN_VERSION = 2
_INNER_BINARY = re.compile(r"(resources/[0-9a-f]+/binaries)/([^/]+)/(.+)")
_INDEX = re.compile(r"\[[\d,]+\]$")
_CATEGORIES = {"Info": "Files read, units loaded and values set by the container", "Error": "Warnings and errors"}


def export_container(
    name: str,
    out: Path,
    settings: Settings,
    platforms: Sequence[str] = ("host",),
    notify: Callable[[str], None] = lambda text: None,
) -> Path:
    """Writes a scenario's instances as one FMU. Equal arguments give equal bytes.

    Inputs that no connection drives become inputs of the container: external signals stay outside. Start values are
    built into the units. Raises the same errors as `run_scenario`, and BuildError where the tool is missing or fails.
    """
    targets = _targets(platforms)
    tool = _tool_version()
    prepared = prepare_scenario(load_scenario(name), settings)
    require_exportable(prepared)
    links = prepared.wiring.links()
    with temporary_folder() as temporary:
        folder = temporary / "units"
        folder.mkdir()
        parts = build_parts(prepared, folder, targets, settings, notify)
        try:
            interface, inner = _interface(prepared, parts, links)
        except InterfaceError as error:
            raise InputError("", f"cannot be a container: {error}", source=prepared.source) from None
        made = temporary / "container.fmu"
        _assemble(folder, made, inner, links, interface, prepared.scenario)
        entries, references = _entries(made, targets, interface.unit_name)
    entries |= _documents(interface, parts, links)
    guid = content_guid(_description(interface, references, parts, tool, ""), *(entries[n] for n in sorted(entries)))
    entries["modelDescription.xml"] = _description(interface, references, parts, tool, guid)
    write_whole(out, zip_bytes(entries))
    if driven := array_labels(interface, "input"):
        notify(f"the host drives {', '.join(driven)}")
    return out


def _targets(platforms: Sequence[str]) -> list[Platform]:
    targets = chosen_platforms(platforms)
    if missing := [target.name for target in targets if target.name not in FOLDERS]:
        raise InputError(
            "--platform",
            f"must be among {', '.join(FOLDERS)} for a container, whose tool has no other "
            "binaries; --format closed-loop builds for all",
            ", ".join(missing),
        )
    return targets


def _tool_version() -> str:
    """BuildError where the tool is missing or too old."""
    try:
        found = version(PACKAGE)
    except PackageNotFoundError:
        found = ""
    if not found or int(found.split(".")[0]) < MIN_VERSION:
        raise BuildError(
            f"containers need {PACKAGE} {MIN_VERSION}.0 or newer{f', {found} is installed' if found else ''}: "
            f"pip install '{PACKAGE}>={MIN_VERSION}.0', or choose --format closed-loop"
        )
    return found


def _interface(
    prepared: PreparedScenario, parts: Mapping[str, Part], links: Mapping[str, str]
) -> tuple[Interface, dict[str, str]]:
    """The variables of the units without connected inputs and outputs not recorded; <instance>.<variable> by name.

    Inputs and outputs are named as in other closed loops, without instance where their names differ.
    """
    scenario = prepared.scenario
    exposed = {
        f"{instance}.{v.name}": v
        for instance, part in parts.items()
        for v in part.variables
        if _is_exposed(f"{instance}.{v.name}", v, links, prepared.wiring.columns)
    }
    inputs = tuple(dict.fromkeys(replace(v, name=n).array for n, v in exposed.items() if v.causality == "input"))
    variables = [
        replace(v, name=n, initial_inputs=inputs if v.initial == "calculated" else ()) for n, v in exposed.items()
    ]
    descriptions = [part.description.coSimulation for part in parts.values() if part.description is not None]
    about = (prepared.file.description or scenario.title).rstrip(".")
    named = without_parts(variables)
    interface = Interface(
        unit_name=re.sub(r"^(?=\d)|\W", "_", prepared.file.name, flags=re.ASCII),
        step_size=prepared.step,
        stop_time=scenario.stop_time,
        description=f"{about}. Units inside: {', '.join(parts)}; steps of {prepared.step:g} s, {scenario.coupling} "
        "coupling; the host drives the inputs",
        variables=(TIME, *named),
        needs_execution_tool=any(d.needsExecutionTool for d in descriptions),
        can_be_instantiated_only_once=any(d.canBeInstantiatedOnlyOncePerProcess for d in descriptions),
        cannot_use_memory_management=True,
        can_get_and_set_state=False,
        can_serialize_state=False,
    )
    return interface, {outer.name: v.name for outer, v in zip(named, variables, strict=True)}


def _is_exposed(name: str, variable: Variable, links: Mapping[str, str], columns: Sequence[str]) -> bool:
    if variable.causality == "output":
        return name in columns  # those that a run records
    return variable.causality != "independent" and name not in links


def _assemble(
    folder: Path,
    out: Path,
    inner: Mapping[str, str],
    links: Mapping[str, str],
    interface: Interface,
    scenario: Scenario,
) -> None:
    """The tool's container of the units in `folder`; `inner` has <instance>.<variable> by name."""
    from fmu_manipulation_toolbox.container import FMUContainer, FMUContainerError
    from fmu_manipulation_toolbox.operations import FMUError

    def port(name: str) -> tuple[str, str]:
        instance, _, variable = name.partition(".")
        return f"{instance}.fmu", variable

    with _silent():
        try:
            container = FMUContainer(interface.unit_name, folder)
            for instance in scenario.instance:
                container.get_fmu(f"{instance}.fmu")
            for to, source in links.items():
                container.add_link(*port(source), *port(to))
            for v in interface.variables[1:]:
                if v.causality in ("input", "parameter"):
                    container.add_input(v.name, *port(inner[v.name]))
                else:
                    container.add_output(*port(inner[v.name]), v.name)
            container.make_fmu(
                out, step_size=interface.step_size, mt=False, sequential=scenario.coupling == "gauss-seidel"
            )
        except (FMUContainerError, FMUError) as error:
            raise BuildError(f"the container cannot be made: {error.reason}") from None


@contextmanager
def _silent() -> Iterator[None]:
    """Suppresses the tool's messages; it raises errors."""
    logger = logging.getLogger("fmu_manipulation_toolbox")
    before, logger.disabled = logger.disabled, True
    try:
        yield
    finally:
        logger.disabled = before


def _entries(made: Path, targets: Sequence[Platform], name: str) -> tuple[dict[str, bytes], dict[str, str]]:
    """Entries of the tool's container to keep, and the value references by variable."""
    with zipfile.ZipFile(made) as archive:
        content = {entry: archive.read(entry) for entry in archive.namelist()}
    entries = {n: c for n, c in content.items() if n.startswith("resources/")}
    entries["resources/container.txt"] = entries["resources/container.txt"].replace(b"\r\n", b"\n")
    for entry in list(entries):  # the tool's binary looks into one folder, on macOS into that of another machine
        if (match := _INNER_BINARY.fullmatch(entry)) and match[2] in FOLDERS:
            entries[f"{match[1]}/{FOLDERS[match[2]]}/{match[3]}"] = entries.pop(entry)
    for target in targets:
        binary = content[f"binaries/{FOLDERS[target.name]}/{name}{target.suffix}"]
        entries |= {f"binaries/{f}/{name}{target.suffix}": binary for f in (FOLDERS[target.name], target.name)}
    scalars = ElementTree.fromstring(content["modelDescription.xml"]).iterfind("ModelVariables/ScalarVariable")
    return entries, {v.attrib["name"]: v.attrib["valueReference"] for v in scalars}  # of two of a name, ours is last


def _description(
    interface: Interface, references: Mapping[str, str], parts: Mapping[str, Part], tool: str, guid: str
) -> bytes:
    """modelDescription.xml with the tool's value references."""
    root = ElementTree.fromstring(model_description(interface, guid=guid, version=version("flexbeams")))
    root.set("generationTool", f"flexbeams, FMUContainer {tool}")
    for scalar in root.iterfind("ModelVariables/ScalarVariable"):
        scalar.set("valueReference", references[scalar.attrib["name"]])
    categories = root.find("LogCategories")
    assert categories is not None
    categories[:] = [ElementTree.Element("Category", name=n, description=text) for n, text in _CATEGORIES.items()]
    if any(part.description is not None for part in parts.values()):  # outputs of FMU files have unknown dependencies
        for unknown in root.iterfind("ModelStructure/*/Unknown"):
            unknown.attrib.pop("dependencies", None)
    return xml_bytes(root)


def _documents(interface: Interface, parts: Mapping[str, Part], links: Mapping[str, str]) -> dict[str, bytes]:
    """Page, picture and licences."""
    arrays = dict.fromkeys((_INDEX.sub("", source), _INDEX.sub("", to)) for to, source in links.items())
    picture = loop_picture(interface, {n: part.unit for n, part in parts.items()}, list(arrays))
    licence = distribution(PACKAGE).read_text("licenses/LICENSE.txt") or ""
    ours = Path(__file__).parents[2] / "fmus/native/LICENSE"
    title = escape(interface.unit_name)
    page = html_page(
        title,
        [
            f"<h1>{title}</h1>",
            f"<p>{escape(interface.description)}.</p>",
            f'<p><img src="../model.png" alt="{title} with its units and signals"></p>',
            table(
                ("unit", "kind", "folder"),
                [(n, part.unit, f"resources/{k:02x}") for k, (n, part) in enumerate(parts.items())],
            ),
            table(("output", "input"), arrays),
            "<p>Variables are named &lt;unit&gt;.&lt;variable&gt;, inputs and outputs without the unit where their "
            f"names differ. The host's steps should be multiples of "
            f"{interface.step_size:g} s: inputs are held meanwhile, and the results at those times do not depend on "
            "the step. In between, outputs stay those of the last inner step.</p>",
            "<p>The units are complete FMUs with sources and documentation. State cannot be saved and restored.</p>",
        ],
    )
    terminals = terminals_document(interface)
    return ({} if terminals is None else {TERMINALS: terminals}) | {
        "model.png": picture,
        "documentation/index.html": page.encode(),
        "documentation/licenses/LICENSE": ours.read_bytes(),
        "documentation/licenses/FMUContainer": licence.encode(),
    }
