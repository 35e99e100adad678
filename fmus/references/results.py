"""Reference results inside a unit, laid out as FMI-LS-REF 1.0.0-beta.1 and MA-HS-Experiments say.

The manifest lists the files; the experiments file says which parameter set, stimuli and reference results belong
together. Neither standard defines their CSV files: these have the time (s) first and quoted names, as the FMI
cross-check rules demand, and two rows of one time where an input jumps, as the Reference FMUs have it.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from xml.etree import ElementTree

import numpy as np

from flexbeams.fmus.documents.xml_documents import Entry, parameter_set, xml_bytes
from flexbeams.fmus.errors import BuildError
from flexbeams.fmus.interface.variables import Interface
from flexbeams.fmus.references.experiments import Experiment, Series

FOLDER = "extra/org.fmi-standard.fmi-ls-ref"
MANIFEST = f"{FOLDER}/fmi-ls-manifest.xml"
NOTES = "documentation/fmi-ls-ref.txt"
EXPERIMENTS, EXPERIMENTS_TYPE = "experiments.exp", "application/x-ma-hs-experiments"
SET_TYPE = "application/x-ssp-parameter-set"
TOLERANCE = 1e-9  # relative to the largest magnitude of an array

_NOTES = """Reference results of {unit}

Folder {folder}; {list} lists the experiments.

{experiments}

An experiment starts at 0 s and uses a fixed step of {step!r} s. Inputs are set at the beginning of a step and held
over it; the first row of the stimuli is set in the initialisation; an input without stimuli keeps its start value. Two
rows of one time are a jump, the second row holds from then on. Parameters are set before the initialisation.

The first row of the references are the values after the initialisation, the others those after the step that ends at
their time. Not every step has a row.

The values were computed independently of this unit, in double precision by another method, with all digits.
Differences, relative to the largest magnitude of an array, were below 1e-10 where this was tested; {tolerance!r} is the
tolerance given.
"""


def reference_results(interface: Interface, experiments: Sequence[Experiment]) -> dict[str, bytes]:
    """The files by their path in the archive; none without experiments.

    These are the manifest, the experiments file, notes, and for each experiment its parameter set, stimuli and results.
    Raises BuildError for a result that is not finite.
    """
    if not experiments:
        return {}
    for e in experiments:
        _require_finite(interface, e)
    files = {}
    related = [(EXPERIMENTS_TYPE, EXPERIMENTS, "experiment/smoke-test", f"Experiments with {interface.unit_name}")]
    for e in experiments:
        if e.parameters:
            files[f"{e.name}.ssv"] = parameter_set(e.name, _entries(interface, e.parameters))
            related.append((SET_TYPE, f"{e.name}.ssv", "parameter", f"Parameters: {e.description}"))
        if e.stimuli is not None and (name := _stimuli_file(e, experiments)) not in files:
            files[name] = table(e.stimuli)
            related.append(("text/csv", name, "other", f"Stimuli: {e.description}"))
        files[f"{e.name}-ref.csv"] = table(e.references)
        related.append(("text/csv", f"{e.name}-ref.csv", "result", f"Reference results: {e.description}"))
    files[EXPERIMENTS] = _experiments_file(interface, experiments)
    listed = "\n".join(f"{e.name}: {e.description}." for e in experiments)
    notes = _NOTES.format(
        unit=interface.unit_name,
        folder=FOLDER,
        list=EXPERIMENTS,
        experiments=listed,
        step=experiments[0].step,
        tolerance=TOLERANCE,
    )
    return {
        MANIFEST: _manifest(related),
        NOTES: notes.encode(),
        **{f"{FOLDER}/{name}": content for name, content in files.items()},
    }


def _require_finite(interface: Interface, experiment: Experiment) -> None:
    series = experiment.references
    for row, column in np.argwhere(~np.isfinite(series.values))[:1]:
        raise BuildError(
            f"{interface.unit_name}: reference {experiment.name}: {series.names[column]} at {series.time[row]:g} s "
            f"must be finite, got {series.values[row, column]}"
        )


def _stimuli_file(experiment: Experiment, experiments: Sequence[Experiment]) -> str:
    """Experiments with the same stimuli share the file."""
    return next(f"{e.name}-in.csv" for e in experiments if e.stimuli is experiment.stimuli)


def table(series: Series) -> bytes:
    """CSV with 17 significant digits where they are needed."""
    header = ",".join(f'"{name}"' for name in ("time", *series.names))
    rows = [
        ",".join(map(repr, (time, *values)))
        for time, values in zip(series.time.tolist(), series.values.tolist(), strict=True)
    ]
    return ("\n".join([header, *rows]) + "\n").encode()


def _entries(interface: Interface, values: Mapping[str, float | bool]) -> Iterator[Entry]:
    for name, value in values.items():
        kind = interface[name].type
        yield name, kind, str(value).lower() if kind == "Boolean" else repr(value), interface[name].unit


def _manifest(related: Iterable[tuple[str, str, str, str]]) -> bytes:
    root = ElementTree.Element(
        "fmiReferences",
        {
            "xmlns:fmi-ls": "http://fmi-standard.org/fmi-ls-manifest",
            "fmi-ls:fmi-ls-name": "org.fmi-standard.fmi-ls-ref",
            "fmi-ls:fmi-ls-version": "1.0.0-beta.1",
            "fmi-ls:fmi-ls-description": "Layered Standard providing information on related files included in an FMU.",
        },
    )
    for kind, source, role, description in related:
        ElementTree.SubElement(root, "Related", type=kind, source=source, role=role, description=description)
    return xml_bytes(root)


def _experiments_file(interface: Interface, experiments: Sequence[Experiment]) -> bytes:
    root = ElementTree.Element(
        "Experiments",
        name=f"Reference results of {interface.unit_name}",
        description="Short runs that show whether a tool simulates the unit correctly",
    )
    for e in experiments:
        element = ElementTree.SubElement(
            root, "Experiment", name=e.name, description=e.description, tolerance=repr(TOLERANCE)
        )
        ElementTree.SubElement(
            element, "TransientSimulation", startTime="0.0", stopTime=repr(e.steps * e.step), stepSize=repr(e.step)
        )
        if e.parameters:
            ElementTree.SubElement(element, "Parameters", type=SET_TYPE, source=f"{e.name}.ssv")
        if e.stimuli is not None:
            ElementTree.SubElement(element, "Stimuli", type="text/csv", source=_stimuli_file(e, experiments))
        ElementTree.SubElement(element, "References", type="text/csv", source=f"{e.name}-ref.csv")
    return xml_bytes(root)
