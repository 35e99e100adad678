"""Wiring of an exported scenario for tools that do not read SSP, beside the units in one folder.

Written from the tools' public documents and projects; not tried in these tools.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from flexbeams.fmus.documents.xml_documents import xml_bytes
from flexbeams.plant.archive import write_whole, zip_bytes
from flexbeams.plant.errors import InputError
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.exporting.bundle import ExportBundle, build_bundle

_COLOURS = ("#ff447cb4", "#ffc38200", "#ff2c8a3c", "#ffc43131", "#ff6a3d9a")  # of MasterSim's blocks


def export_wiring(
    name: str,
    out: Path,
    settings: Settings,
    platforms: Sequence[str] = ("host",),
    notify: Callable[[str], None] = lambda text: None,
    *,
    wiring: Sequence[str] = (),
    flags_as_real: bool = False,
) -> Path:
    """Writes a scenario's units and the wiring files of tools, keys of FILES, into a folder or FILE.zip.

    Raises the same errors as `build_bundle`. Equal arguments give equal bytes.
    """
    archived = out.suffix.lower() == ".zip"
    if out.exists() and out.is_dir() == archived:
        raise InputError("--out", "must be a folder, or FILE.zip", str(out))
    with temporary_folder() as folder:
        bundle = build_bundle(name, folder, settings, platforms, notify, flags_as_real=flags_as_real)
        entries = {file.name: file.read_bytes() for file in bundle.files.values()}
    for tool in wiring:
        file, write = FILES[tool]
        entries[file.format(name=_identifier(bundle.name))] = write(bundle)
    if archived:
        write_whole(out, zip_bytes(entries))
    else:
        for path, content in entries.items():
            write_whole(out / path, content)
    return out


def _identifier(name: str) -> str:
    return re.sub(r"^(?=\d)|\W", "_", name, flags=re.ASCII)


def veos_connections(bundle: ExportBundle) -> bytes:
    """The JSON of `veos model connect`: a signal connection for each element."""
    connections = [
        {"InSignalReference": f"/{link.end}/{link.input}", "OutSignalReference": f"/{link.start}/{link.output}"}
        for link in bundle.links
    ]
    package = {"PackageType": "StandardCommunicationPackage", "SignalConnections": connections}
    return (json.dumps({"CommunicationPackages": [package]}, indent=2) + "\n").encode()


def mastersim_project(bundle: ExportBundle) -> bytes:
    """A project of MasterSim with a fixed step."""
    mode = "GAUSS_SEIDEL" if bundle.coupling == "gauss-seidel" else "GAUSS_JACOBI"
    settings = {
        "tStart": "0 s",
        "tEnd": f"{bundle.stop_time!r} s",
        "hMax": f"{bundle.step!r} s",
        "hMin": f"{bundle.step!r} s",
        "hFallBackLimit": f"{bundle.step!r} s",
        "hStart": f"{bundle.step!r} s",
        "hOutputMin": f"{bundle.step!r} s",
        "adjustStepSize": "no",
        "absTol": "1e-06",
        "relTol": "1e-05",
        "MasterMode": mode,
        "ErrorControlMode": "NONE",
        "maxIterations": "1",
    }
    lines = [f"{key:<20} {value}" for key, value in settings.items()]
    lines.append("")
    for k, (name, file) in enumerate(bundle.files.items()):
        lines.append(f'simulator {k} {k} {name} {_COLOURS[k % len(_COLOURS)]} "{file.name}"')
    lines.append("")
    lines += [f"graph {link.start}.{link.output} {link.end}.{link.input}" for link in bundle.links]
    return ("\n".join(lines) + "\n").encode()


def dymola_model(bundle: ExportBundle) -> bytes:
    """A Modelica model that connects the imported units; its comment says how to import them."""
    model = _identifier(bundle.name)
    imports = [
        f'  //   importFMU(fileName="{file.name}", integrate=false, modelName="{_model_name(file)}");'
        for file in dict.fromkeys(bundle.files.values())
    ]
    step, stop = repr(bundle.step), repr(bundle.stop_time)
    components = [
        f"  {_model_name(file)} {name}(fmi_CommunicationStepSize={step}, fmi_StopTime={stop});"
        for name, file in bundle.files.items()
    ]
    connections = [f"  connect({link.start}.{link.output}, {link.end}.{link.input});" for link in bundle.links]
    text = [
        f'model {model} "{_quoted(bundle.description)}"',
        "  // Import the units first, with structured declaration of variables:",
        *imports,
        *components,
        "equation",
        *connections,
        f"  annotation (experiment(StopTime={stop}, Interval={step}));",
        f"end {model};",
    ]
    return ("\n".join(text) + "\n").encode()


def _model_name(file: Path) -> str:
    return f"{_identifier(file.stem)}_fmu"


def _quoted(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')


def simulink_script(bundle: ExportBundle) -> bytes:
    """A MATLAB script that makes a model: a block for each unit, and a line for each pair of connected arrays."""
    model = f"{_identifier(bundle.name)}_model"
    lines = [
        f"% {bundle.name}: blocks of the units and the lines between them. Run it in the folder of the units.",
        f"model = '{model}';",
        "new_system(model); open_system(model);",
        f"set_param(model, 'SolverType', 'Fixed-step', 'Solver', 'FixedStepDiscrete', 'FixedStep', '{bundle.step!r}', "
        "...",
        f"    'StopTime', '{bundle.stop_time!r}');",
    ]
    for k, (name, file) in enumerate(bundle.files.items()):
        left = 60 + 300 * k
        lines += [
            f"add_block('simulink_extras/FMU Import/FMU', [model '/{name}'], 'FMUName', '{file.name}', ...",
            f"    'Position', [{left} 60 {left + 180} 260]);",
        ]
    inputs, outputs = ({n: _ports(unit, kind) for n, unit in bundle.units.items()} for kind in ("input", "output"))
    for start, output, end, target in dict.fromkeys(
        (link.start, _array(link.output), link.end, _array(link.input)) for link in bundle.links
    ):
        sizes = len(outputs[start][output]), len(inputs[end][target])
        if sizes[0] == sizes[1]:
            ports = _position(outputs[start], output), _position(inputs[end], target)
            lines.append(
                f"connect_arrays(model, '{start}', {_span(*ports[0])}, '{end}', {_span(*ports[1])});"
                f" % {output} to {target}"
            )
    lines.append(_CONNECT)
    return ("\n".join(lines) + "\n").encode()


_CONNECT = """
% Arrays are one port each, or one port for each element, as the release and the block's settings have it.
function connect_arrays(model, start, from, finish, to)
    out = get_param([model '/' start], 'PortHandles').Outport;
    in = get_param([model '/' finish], 'PortHandles').Inport;
    if numel(out) < from.elements(end) || numel(in) < to.elements(end)
        add_line(model, out(from.array), in(to.array), 'autorouting', 'smart');
        return
    end
    for k = 1:numel(from.elements)
        add_line(model, out(from.elements(k)), in(to.elements(k)), 'autorouting', 'smart');
    end
end
"""


def _ports(unit: object, causality: str) -> dict[str, list[str]]:
    """Elements by array, in the order of the unit."""
    arrays: dict[str, list[str]] = {}
    for v in unit.modelVariables:  # type: ignore[attr-defined]
        if v.causality == causality:
            arrays.setdefault(_array(v.name), []).append(v.name)
    return arrays


def _array(name: str) -> str:
    return name.partition("[")[0]


def _position(arrays: Mapping[str, Sequence[str]], name: str) -> tuple[int, int, int]:
    """Number of an array among the arrays, and of its first and last element among all elements, from 1."""
    before = list(arrays)[: list(arrays).index(name)]
    first = 1 + sum(len(arrays[array]) for array in before)
    return len(before) + 1, first, first + len(arrays[name]) - 1


def _span(array: int, first: int, last: int) -> str:
    return f"struct('array', {array}, 'elements', {first}:{last})"


def te1420_description(bundle: ExportBundle) -> bytes:
    """Settings under which TwinCAT's TE1420 compiles the sources of these units, for its folder TE1420-TargetForFmi."""
    root = ElementTree.Element(
        "CustomConfigurations",
        {
            "xmlns:xsi": "http://www.w3.org/2001/XMLSchema-instance",
            "xsi:noNamespaceSchemaLocation": "CustomFmu.xsd",
        },
    )
    configuration = ElementTree.SubElement(root, "FmuConfiguration")
    for key, value in (
        ("ToolName", "flexbeams"),  # the generationTool of the descriptions
        ("AdditionalInclude", "$(ProjectDir);$(ProjectDir)sources;"),
        ("PreprocessorDefinitions", ""),
        ("ExcludedFromBuild", ""),
    ):
        ElementTree.SubElement(configuration, key).text = value
    return xml_bytes(root)


# Tool: its file beside the units, and what writes it
FILES: dict[str, tuple[str, Callable[[ExportBundle], bytes]]] = {
    "veos": ("connections.json", veos_connections),
    "simulink": ("make_{name}.m", simulink_script),
    "dymola": ("{name}.mo", dymola_model),
    "mastersim": ("{name}.msim", mastersim_project),
    "te1420": ("flexbeams.xml", te1420_description),
}
