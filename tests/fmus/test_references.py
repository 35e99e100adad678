"""Reference results inside units: their layout, who reproduces them, and that `validate` finds those that differ."""

import csv
import io
import re
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest

from flexbeams.fmus.documents.xml_documents import SSV
from flexbeams.fmus.errors import BuildError
from flexbeams.fmus.interface.variables import Interface
from flexbeams.fmus.packaging.build import build_units, native_unit
from flexbeams.fmus.references.experiments import Experiment
from flexbeams.fmus.references.results import FOLDER, MANIFEST, NOTES, TOLERANCE, reference_results
from flexbeams.fmus.units.catalogue import CATALOGUE, kind_named
from flexbeams.fmus.units.tracking_controller import TRACKING_CONTROLLER
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.api.units import build
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.time_table import TimeTable
from flexbeams.scenarios.importing.xml_reading import read_document, schema_problems
from flexbeams.scenarios.simulation.instance import UnitInstance
from flexbeams.scenarios.validation.reference_files import (
    ReferenceRun,
    declared_experiments,
    read_reference_run,
    values_at,
)
from flexbeams.scenarios.validation.references import deviation, simulate_reference
from tests.helpers import UNITS, Workshop, design_of
from tests.native.workshop import native_folder, needs_zig, workspace
from tests.oracles.monolithic import feedforward, largest_difference, plant_matrices, plant_run

FMI_LS = "{http://fmi-standard.org/fmi-ls-manifest}"
PRECISION = {"kiel": 1e-12, "five_beams": 1e-10}  # of the flat parameterisation, which loses digits by cancellation
CASES = [
    (structure, basis, unit)
    for structure, basis in (("single_beam", "segment"), ("kiel", "clamped_free"), ("five_beams", "clamped_free"))
    for unit in UNITS
]


@cache
def carried(structure: str, basis: str, unit: str) -> tuple[Interface, dict[str, bytes], list[Experiment]]:
    """A unit's interface, the files that it carries, and what they are made from."""
    design = design_of(structure, basis)
    model = design.model()
    kind = kind_named(unit)
    assert kind is not None
    interface, experiments = kind.declare(design, model), list(kind.experiments(design, model))
    return interface, reference_results(interface, experiments), experiments


@cache
def built() -> Path:
    """The folder with the native units as `flexbeams build` makes them."""
    design = design_of()
    build_units(CATALOGUE, design, design.model(), workspace() / "with-references")
    return workspace() / "with-references" / "native"


def laid_out(folder: Path, files: dict[str, bytes]) -> Path:
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder


def rows_of(content: bytes) -> tuple[list[str], np.ndarray]:
    """Names without the time, and a table with it."""
    header, *rows = csv.reader(io.StringIO(content.decode()))
    assert header[0] == "time"
    return header[1:], np.array(rows, dtype=float)


@pytest.mark.parametrize(("structure", "basis", "unit"), CASES)
def test_layout(structure: str, basis: str, unit: str) -> None:
    """FMI-LS-REF 1.0.0-beta.1: one manifest that lists every file of the folder, and MA-HS-Experiments inside."""
    _, files, made = carried(structure, basis, unit)
    manifest = ElementTree.fromstring(files[MANIFEST])
    assert manifest.tag == "fmiReferences"
    assert {k.removeprefix(FMI_LS): v for k, v in manifest.attrib.items()} == {
        "fmi-ls-name": "org.fmi-standard.fmi-ls-ref",
        "fmi-ls-version": "1.0.0-beta.1",
        "fmi-ls-description": "Layered Standard providing information on related files included in an FMU.",
    }
    assert all(k.startswith(FMI_LS) for k in manifest.attrib)
    related = {r.attrib["source"]: r.attrib for r in manifest}
    assert all(r.tag == "Related" and r.attrib.keys() == {"type", "source", "role", "description"} for r in manifest)
    assert len(related) == len(manifest)
    assert {f"{FOLDER}/{name}" for name in related} == files.keys() - {MANIFEST, NOTES}
    [listed] = [r for r in related.values() if r["role"] == "experiment/smoke-test"]
    assert listed["type"] == "application/x-ma-hs-experiments"
    assert listed["source"].endswith(".exp")
    document = ElementTree.fromstring(files[f"{FOLDER}/{listed['source']}"])
    assert (document.tag, document.attrib.keys()) == ("Experiments", {"name", "description"})
    roles = {
        "Parameters": ("parameter", "application/x-ssp-parameter-set"),
        "Stimuli": ("other", "text/csv"),
        "References": ("result", "text/csv"),
    }
    for element, experiment in zip(document, made, strict=True):
        assert element.attrib == {
            "name": experiment.name,
            "description": experiment.description,
            "tolerance": repr(TOLERANCE),
        }
        settings, *parts = element
        assert settings.tag == "TransientSimulation"
        assert settings.attrib == {
            "startTime": "0.0",
            "stopTime": repr(experiment.steps * experiment.step),
            "stepSize": repr(design_of(structure, basis).options.sample_time),
        }
        assert [p.tag for p in parts] == [
            tag
            for tag, there in (
                ("Parameters", experiment.parameters),
                ("Stimuli", experiment.stimuli),
                ("References", True),
            )
            if there
        ]
        for part in parts:
            entry = related[part.attrib["source"]]
            assert (entry["role"], entry["type"]) == roles[part.tag]
            assert part.attrib["type"] == entry["type"]
    assert all(e.name in files[NOTES].decode() and e.description in files[NOTES].decode() for e in made)
    assert sum(map(len, files.values())) < 150_000


@pytest.mark.parametrize(("structure", "basis", "unit"), CASES)
def test_tables_and_parameters_are_of_the_unit(structure: str, basis: str, unit: str) -> None:
    """All outputs in every reference; stimuli drive inputs and begin at their start values; parameters are others."""
    interface, files, made = carried(structure, basis, unit)
    for experiment in made:
        names, references = rows_of(files[f"{FOLDER}/{experiment.name}-ref.csv"])
        assert names == [v.name for v in interface.of("output")]
        np.testing.assert_array_equal(references[:, 1:], experiment.references.values)  # all digits
        ticks = references[:, 0] / experiment.step
        np.testing.assert_allclose(ticks, np.round(ticks), rtol=0, atol=1e-6)
        assert ticks[0] == 0
        assert references[-1, 0] == experiment.steps * experiment.step
        assert np.ptp(references[:, 1:], axis=0).max() > 0
        if experiment.stimuli is not None:
            source = next(f"{FOLDER}/{e.name}-in.csv" for e in made if e.stimuli is experiment.stimuli)
            names, stimuli = rows_of(files[source])
            assert names == [v.name for v in interface.of("input")]
            assert stimuli[0].tolist() == [0.0, *[v.start for v in interface.of("input")]]
            assert (np.diff(stimuli[:, 0]) >= 0).all()
            assert stimuli[-1, 0] == references[-1, 0]
        if experiment.parameters:
            document = read_document(files[f"{FOLDER}/{experiment.name}.ssv"], "ssv")
            assert schema_problems(document, SSV) == []
            for parameter in document.iter(f"{{{SSV}}}Parameter"):
                variable = interface[parameter.get("name")]
                assert variable.causality == "parameter"
                assert parameter[0].tag == f"{{{SSV}}}{variable.type}"
                assert parameter[0].get("unit") == variable.unit
                assert float(parameter[0].get("value")) == experiment.parameters[variable.name] != variable.start


def test_experiments_show_what_they_are_for() -> None:
    """The controller's limit holds some voltages for a while; a transition ends, and one is under way to the end."""
    _, _, made = carried("kiel", "clamped_free", "TrackingController")
    free, limited = (e.references.values[:, -1] for e in made)
    assert not free.any()
    assert 0.1 < limited.mean() < 0.9
    _, _, (transition, retarget) = carried("kiel", "clamped_free", "FlatnessFeedforward")
    assert transition.references.values[:, -1].tolist() == [0.0, *[1.0] * 32, *[0.0] * 4]
    assert retarget.references.values[:, -1].tolist() == [0.0, *[1.0] * 40]
    assert retarget.stimuli is not None
    assert len(np.unique(retarget.stimuli.values, axis=0)) == 3
    _, _, (pushed, released) = carried("kiel", "clamped_free", "BeamPlant")
    assert pushed.references.values[0].tolist() == [0.0] * 10
    assert np.abs(released.references.values[0]).min() > 1e-9
    assert len(released.parameters) == 13 + 4


def test_references_agree_with_the_monolithic_oracle() -> None:
    """The plant sampled by scipy; the feedforward from closed forms of Theta's derivatives."""
    design = design_of()
    step, model = design.options.sample_time, design.model()
    _, _, (_, released) = carried("kiel", "clamped_free", "BeamPlant")
    physical = {k: v for k, v in released.parameters.items() if not k.startswith("start")}
    plant = plant_matrices(model, step, {k: float(v) for k, v in physical.items()})
    voltage = [float(v) for k, v in released.parameters.items() if k.startswith("start")]
    held = np.zeros((released.steps + 1, len(voltage)))
    run = plant_run(plant, plant.at_rest @ np.array(voltage), held, held, np.zeros((len(held), plant.F.shape[1])))
    at = np.round(released.references.time / step).astype(int)
    found = np.hstack([run["plant.y_pi"], run["plant.y_pm"]])[at]
    for columns in (slice(0, 4), slice(4, 10)):
        assert largest_difference(released.references.values[:, columns], found[:, columns]) < 1e-12

    _, _, made = carried("kiel", "clamped_free", "FlatnessFeedforward")
    for experiment in made:
        assert experiment.stimuli is not None
        time, values = experiment.stimuli.time, experiment.stimuli.values
        jumps = np.flatnonzero(np.diff(time) == 0) + 1
        oracle = feedforward(
            design,
            steps=experiment.steps,
            step=step,
            preview=experiment.parameters.get("preview", 0),
            targets=[(time[k], values[k]) for k in jumps],
            transition_time=experiment.parameters.get("transition_time"),
        )
        at = np.round(experiment.references.time / step).astype(int)
        expected = np.hstack([oracle.u_ff, oracle.x_ref, oracle.y_ref, oracle.moving])[at]
        for columns in (slice(0, 4), slice(4, 34), slice(34, 38), slice(38, 39)):
            assert largest_difference(experiment.references.values[:, columns], expected[:, columns]) < 1e-11


def reference_runs(files: dict[str, bytes], unit: Path, folder: Path) -> dict[str, ReferenceRun]:
    """The experiments by name, as they are read for an extracted unit."""
    description = fmpy.read_model_description(str(unit), validate=False)
    laid_out(folder, files)
    return {e.name: read_reference_run(folder, description, e) for e in declared_experiments(folder, description)}


@pytest.mark.parametrize(
    ("kind", "structure", "unit"),
    [
        pytest.param(kind, structure, unit, marks=needs_zig if kind == "native" else ())
        for kind, structure, unit in product(("native", "python"), PRECISION, UNITS)
    ],
)
def test_units_reproduce_the_references(
    kind: str, structure: str, unit: str, workshop: Workshop, tmp_path: Path
) -> None:
    """Both kernels, far better than the tolerance that is given."""
    folder = native_folder(unit, structure) if kind == "native" else workshop.folder(unit, structure)
    _, files, made = carried(structure, "clamped_free", unit)
    trials = reference_runs(files, folder, tmp_path)
    assert list(trials) == [e.name for e in made]
    for reference in trials.values():
        assert reference.tolerance == TOLERANCE
        instance = UnitInstance("unit", folder, fmpy.read_model_description(str(folder), validate=False), print)
        try:
            assert deviation(reference, simulate_reference(reference, instance)).size < PRECISION[structure]
        finally:
            instance.close()


@needs_zig
@pytest.mark.parametrize("unit", UNITS)
def test_another_importer_reproduces_them(unit: str, tmp_path: Path) -> None:
    """FMPy, from the files as they are: it joins the rows of the stimuli by lines."""
    file = built() / f"{unit}.fmu"
    interface, _, made = carried("kiel", "clamped_free", unit)
    fmpy.extract(str(file), unzipdir=str(tmp_path / unit))
    for experiment in made:
        stimuli = None
        if experiment.stimuli is not None:
            source = next(f"{e.name}-in.csv" for e in made if e.stimuli is experiment.stimuli)
            stimuli = fmpy.util.read_csv(tmp_path / unit / FOLDER / source)
        result = fmpy.simulate_fmu(
            str(tmp_path / unit),
            start_time=0.0,
            stop_time=experiment.steps * experiment.step,
            input=stimuli,
            step_size=experiment.step,
            output_interval=experiment.step,
            start_values=dict(experiment.parameters),
            output=[v.name for v in interface.of("output")],
        )
        at = np.round(experiment.references.time / experiment.step).astype(int)
        assert len(result) == experiment.steps + 1
        for array, span in interface.arrays.items():
            if interface.variables[span.start].causality == "output":
                names = [interface.variables[k].name for k in span]
                columns = [experiment.references.names.index(n) for n in names]
                found = np.stack([result[n][at] for n in names], axis=1).astype(float)
                assert largest_difference(found, experiment.references.values[:, columns]) < 1e-11, array


@needs_zig
def test_two_builds_have_equal_bytes(tmp_path: Path) -> None:
    design = design_of()
    for path in build_units(CATALOGUE, design, design.model(), tmp_path):
        assert path.read_bytes() == (built() / path.name).read_bytes()
        with zipfile.ZipFile(path) as archive:
            for name, content in carried("kiel", "clamped_free", path.stem)[1].items():
                assert archive.read(name) == content


def test_a_unit_with_other_start_values_carries_none() -> None:
    design, out = design_of(), Path("unit.fmu")
    assert native_unit(TRACKING_CONTROLLER, design, design.model(), out).extra.keys() >= {MANIFEST, NOTES}
    assert native_unit(TRACKING_CONTROLLER, design, design.model(), out, {"feedback": False}).extra == {}


# validate


def rewritten(file: Path, out: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
    """A copy of an FMU with some entries changed, or left out."""
    with zipfile.ZipFile(file) as source, zipfile.ZipFile(out, "w") as archive:
        for name in source.namelist():
            if (content := change(name, source.read(name))) is not None:
                archive.writestr(name, content)
    return out


@needs_zig
def test_validate_reports_agreement(capsys: pytest.CaptureFixture[str]) -> None:
    files = [built() / f"{unit}.fmu" for unit in UNITS]
    assert main(["validate", *map(str, files)]) == 0
    lines = capsys.readouterr().out.splitlines()
    for file in files:
        assert lines.pop(0) == f"{file}: valid"
        for experiment in carried("kiel", "clamped_free", file.stem)[2]:
            head, _, size = lines.pop(0).partition("agrees to ")
            assert head == f"{file}: reference {experiment.name}: "
            assert float(size) < PRECISION["kiel"]
    assert lines == []
    assert main(["validate", "--no-run", str(files[2])]) == 0
    assert capsys.readouterr().out == f"{files[2]}: valid\n"


@needs_zig
def test_validate_finds_a_tampered_reference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One value, off by a millionth of the largest; the other experiment still agrees."""

    def change(name: str, content: bytes) -> bytes:
        if not name.endswith("limited-ref.csv"):
            return content
        lines = content.decode().splitlines()
        row = lines[50].split(",")
        row[2] = repr(float(row[2]) + 4e-4)
        return "\n".join([*lines[:50], ",".join(row), *lines[51:]]).encode()

    file = rewritten(built() / "TrackingController.fmu", tmp_path / "tampered.fmu", change)
    assert main(["validate", str(file)]) == 1
    valid, swinging, limited = capsys.readouterr().out.splitlines()
    assert valid == f"{file}: valid"
    assert ": agrees to " in swinging
    assert limited.startswith(f"{file}: reference limited: u[2] at 0.0098 s must be ")
    assert " to 1e-09, got " in limited


@needs_zig
@pytest.mark.parametrize(
    ("change", "line"),
    [
        (
            lambda name, content: None if name.startswith("binaries/") else content,
            "reference swinging is not checked: unit failed at 0 s in loading its library: ",
        ),
        (
            lambda name, content: None if name.endswith("swinging-ref.csv") else content,
            "reference swinging is not checked: source must be a file in the unit, got 'swinging-ref.csv'",
        ),
        (
            lambda name, content: b"<fmiReferences" if name == MANIFEST else content,
            f"references are not checked: {MANIFEST}: is not well-formed XML",
        ),
        (
            lambda name, content: b"<fmiOther/>" if name == MANIFEST else content,
            f"references are not checked: {MANIFEST} must be a manifest of fmiReferences, got 'fmiOther'",
        ),
    ],
)
def test_what_cannot_be_checked_fails(
    change: Callable[[str, bytes], bytes | None], line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = rewritten(built() / "TrackingController.fmu", tmp_path / "other.fmu", change)
    assert main(["validate", str(file)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"{file}: valid"
    assert main(["validate", "--no-run", str(file)]) == 0
    assert lines[1].startswith(f"{file}: {line}")


def test_results_that_are_not_finite_are_refused() -> None:
    """In the references of a unit that is built: with the experiment, the variable and the time."""
    interface, _, made = carried("kiel", "clamped_free", "TrackingController")
    values = made[0].references.values.copy()
    values[7, 2] = np.nan
    spoiled = replace(made[0], references=replace(made[0].references, values=values))
    time, name = made[0].references.time[7], made[0].references.names[2]
    with pytest.raises(BuildError, match=rf"swinging: {re.escape(name)} at {time:g} s must be finite, got nan"):
        reference_results(interface, [spoiled, *made[1:]])


@needs_zig
def test_build_runs_the_experiments_of_its_units(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A unit whose results differ from its references is not left behind."""
    design = design_of()
    monkeypatch.setattr(
        "flexbeams.scenarios.api.units.build_units",
        lambda *_, **__: [rewritten(built() / "TrackingController.fmu", tmp_path / "bad.fmu", spoil)],
    )

    def spoil(name: str, content: bytes) -> bytes:
        return content.replace(b'value="0.00108"', b'value="1.5"')

    with pytest.raises(BuildError, match=r"bad.fmu: reference limited: unit failed at 0 s in setReal"):
        build(design, ["TrackingController"], folder=tmp_path)
    assert not (tmp_path / "bad.fmu").exists()


@needs_zig
def test_a_unit_that_refuses_an_experiment_is_at_fault(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = rewritten(
        built() / "TrackingController.fmu",
        tmp_path / "refusing.fmu",
        lambda name, content: content.replace(b'value="0.00108"', b'value="1.5"'),
    )
    assert main(["validate", str(file)]) == 1
    assert (
        "reference limited: unit failed at 0 s in setReal: integral_gain must be <= 0.0012" in capsys.readouterr().out
    )


# What others write


def described(*names: str, **experiment: float) -> Any:
    """A description with inputs u.., outputs y.., a Boolean b and a discrete input d."""
    variables = [
        SimpleNamespace(
            name=n,
            type="Boolean" if n == "b" else "Real",
            unit=None,
            causality="input" if n in "ud" else "output",
            variability="discrete" if n in "bd" else "continuous",
        )
        for n in names
    ]
    return SimpleNamespace(modelVariables=variables, defaultExperiment=SimpleNamespace(**experiment))


def manifest(related: str) -> bytes:
    return f"<fmiReferences>{related}</fmiReferences>".encode()


REFERENCE = b"time,y\n0,1\n0.5,2\n1.5,3\n"
EXP = '<Related type="application/x-ma-{}-experiments" source="a.exp" role="experiment"/>'


@pytest.mark.parametrize("layout", ["alpha", "draft", "default"])
def test_other_layouts_are_read(layout: str, tmp_path: Path) -> None:
    """FMI-LS-REF 1.0.0-alpha.1 with settings as attributes; earlier drafts; a result of the default experiment."""
    settings = (
        '<Experiment name="x" startTime="0" stopTime="1.5" stepSize="0.25" tolerance="1e-3"><References '
        'source="y.csv"/></Experiment>'
    )
    files = {
        "alpha": {
            MANIFEST: manifest(EXP.format("ls")),
            f"{FOLDER}/a.exp": f"<Experiments>{settings}</Experiments>".encode(),
        },
        "draft": {MANIFEST: manifest(settings)},
        "default": {MANIFEST: manifest('<Related type="text/csv" source="y.csv" role="result"/>')},
    }[layout]
    laid_out(tmp_path, {**files, f"{FOLDER}/y.csv": REFERENCE})
    description = described("y", startTime="0", stepSize="0.25")
    [declared] = declared_experiments(tmp_path, description)
    reference = read_reference_run(tmp_path, description, declared)
    assert declared.name == ("y.csv" if layout == "default" else "x")
    assert (reference.start, reference.step, reference.steps_done) == (0.0, 0.25, [0, 2, 6])
    assert reference.tolerance == (1e-6 if layout == "default" else 1e-3)
    assert reference.expected.tolist() == [[1.0], [2.0], [3.0]]
    assert reference.driven.shape == (7, 0)


def test_signals_may_be_picked(tmp_path: Path) -> None:
    laid_out(
        tmp_path,
        {
            MANIFEST: manifest(EXP.format("hs")),
            f"{FOLDER}/y.csv": b"time,y2,b,y1\n0,1,0,2\n1,3,1,4\n",
            f"{FOLDER}/a.exp": b'<Experiments><Experiment name="x"><TransientSimulation stepSize="1"/><References '
            b'source="y.csv"><Signal name="b"/><Signal name="y1"/></References></Experiment>'
            b"</Experiments>",
        },
    )
    description = described("y1", "y2", "b")
    [declared] = declared_experiments(tmp_path, description)
    reference = read_reference_run(tmp_path, description, declared)
    assert reference.names == ["y1", "b"]  # Reals first
    assert reference.expected.tolist() == [[2.0, 0.0], [4.0, 1.0]]


@pytest.mark.parametrize(
    ("inside", "message"),
    [
        ("<SteadyState/><References source='y.csv'/>", "SteadyState is not supported"),
        ("<Stimuli source='u.csv'/>", "has no reference results"),
        ("<References source='y.h5' type='application/hdf5'/>", "y.h5 must be text/csv, got 'application/hdf5'"),
        ("<References source='y.csv' mapping='y.ssm'/>", "mappings are not supported"),
        ("<References source='../../../y.csv'/>", "must be a path inside the unit"),
        ("<References source='/etc/hosts'/>", "must be a path inside the unit"),
        ("<References source='https://example.org/y.csv'/>", "must be a path inside the unit"),
        ("<References source='z.csv'/>", "must name variables of the unit; did you mean 'y'"),
        ("<References source='y.csv'><Signal name='q'/></References>", "must name a column of the references"),
        (
            "<TransientSimulation stepSize='0.3'/><References source='y.csv'/>",
            "must have rows at multiples of 0.3 s only",
        ),
        ("<TransientSimulation stepSize='1e-9'/><References source='y.csv'/>", "must lie within 1000000 steps"),
        ("<TransientSimulation startTime='1'/><References source='y.csv'/>", "must lie within 1000000 steps"),
        ("<TransientSimulation stepSize='soon'/><References source='y.csv'/>", "stepSize must be a finite number"),
        ("<TransientSimulation stepSize='-1'/><References source='y.csv'/>", "stepSize must be > 0"),
        ("<Stimuli source='y.csv'/><References source='y.csv'/>", "y must be an input to be driven by stimuli"),
        (
            "<Parameters source='p.ssv' type='text/csv'/><References source='y.csv'/>",
            "must be application/x-ssp-parameter-set",
        ),
        ("<Parameters source='p.ssv'/><References source='y.csv'/>", "must be valid by the schema of SSP 1.0"),
    ],
)
def test_what_is_not_supported_is_refused(inside: str, message: str, tmp_path: Path) -> None:
    laid_out(
        tmp_path,
        {
            MANIFEST: manifest(EXP.format("hs")),
            f"{FOLDER}/y.csv": REFERENCE,
            f"{FOLDER}/u.csv": b"time,u\n0,0\n",
            f"{FOLDER}/z.csv": b"time,yy\n0,0\n",
            f"{FOLDER}/p.ssv": b"<ParameterSet/>",
            "y.csv": REFERENCE,
            f"{FOLDER}/a.exp": f'<Experiments><Experiment name="x">{inside}</Experiment></Experiments>'.encode(),
        },
    )
    description = described("u", "y", stepSize=0.5)
    [declared] = declared_experiments(tmp_path, description)
    with pytest.raises(InputError) as refusal:
        read_reference_run(tmp_path, description, declared)
    assert message in str(refusal.value)


def test_results_without_stimuli_are_not_run(tmp_path: Path) -> None:
    """A unit with inputs, and a result of who knows what inputs."""
    laid_out(
        tmp_path,
        {MANIFEST: manifest('<Related type="text/csv" source="y.csv" role="result"/>'), f"{FOLDER}/y.csv": REFERENCE},
    )
    [declared] = declared_experiments(tmp_path, described("u", "y"))
    assert declared.problem == "has no stimuli for the unit's inputs"


def test_stimuli_between_their_rows() -> None:
    """Joined by lines, held where discrete, the last row of a jump; the first and last value beyond the ends."""
    variables = {v.name: v for v in described("u", "d").modelVariables}
    stimuli = TimeTable(
        time=np.array([0.1, 0.3, 0.3, 0.5]),
        columns=["u", "d"],
        values=np.array([[1.0, 1.0], [2.0, 2.0], [5.0, 5.0], [7.0, 7.0]]),
    )
    values = values_at(stimuli, 0.1 * np.arange(8), 0.1, variables)
    np.testing.assert_allclose(values[:, 0], [1, 1, 1.5, 5, 6, 7, 7, 7], rtol=1e-12)
    np.testing.assert_array_equal(values[:, 1], [1, 1, 1, 5, 5, 7, 7, 7])
