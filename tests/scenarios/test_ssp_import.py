"""Packages of others: what the runner takes, what it refuses in one line, and that it leaves nothing behind."""

import io
import re
import sys
import zipfile
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest

import flexbeams as fb
from flexbeams.fmus.packaging.python import build_python_units
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.exporting.ssp import export_ssp
from flexbeams.scenarios.results.files import read_results
from flexbeams.scenarios.runs.observer import Observer
from flexbeams.scenarios.runs.package import run_package
from flexbeams.scenarios.runs.scenario import run_scenario
from flexbeams.scenarios.simulation.instance import UnitInstance
from flexbeams.scenarios.validation.package import package_problems
from tests.helpers import ALLOCATOR_NOISE, CYCLES, PUSHED_SCENARIO, resident
from tests.units.lag_interface import a, b, gain, lag_unit, x_start
from tests.units.loaded import pushed_in_turn

pytestmark = pytest.mark.native

STEP = 2e-4


class Shop:
    """One small package, its scenario, and changed copies of it."""

    def __init__(self, folder: Path, build_folder: Path) -> None:
        self.folder, self.settings = folder, Settings(record_animation=False, build_folder=build_folder)
        self.scenario = folder / "pushed.toml"
        self.scenario.write_text(PUSHED_SCENARIO.format(stop=0.1))
        self.package = export_ssp(str(self.scenario), folder / "pushed.ssp", self.settings)
        with zipfile.ZipFile(self.package) as archive:
            self.entries = {n: archive.read(n) for n in archive.namelist()}

    def changed(self, name: str, *changes: tuple[str, str], where: str = "SystemStructure.ssd", **entries: Any) -> Path:
        """A copy with texts of one document replaced by regular expression; None as an entry leaves it out."""
        contents: dict[str, bytes | None] = dict(self.entries)
        text = self.entries[where].decode()
        for old, new in changes:
            assert re.search(old, text, re.DOTALL), old
            text = re.sub(old, new, text, count=1, flags=re.DOTALL)
        contents[where] = text.encode()
        contents |= {
            key.replace("__", "/").replace("_fmu", ".fmu").replace("_ssv", ".ssv").replace("_ssd", ".ssd"): v
            for key, v in entries.items()
        }
        path = self.folder / f"{name}.ssp"
        with zipfile.ZipFile(path, "w") as archive:
            for key, content in contents.items():
                if content is not None:
                    archive.writestr(key, content)
        return path


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory, run_folder: Path) -> Shop:
    return Shop(tmp_path_factory.mktemp("packages"), run_folder / "build/fmus")


FIRST = r'<ssd:Connection startElement="source" startConnector="y_target\[1\]" [^>]*/>'  # to the feedforward


def wire(start: str, end: str) -> str:
    (a, output), (b, target) = start.split("."), end.split(".")
    return f'<ssd:Connection startElement="{a}" startConnector="{output}" endElement="{b}" endConnector="{target}" />'


NESTED = (
    '<ssd:System name="inner"><ssd:Elements><ssd:Component name="x" source="resources/BeamPlant.fmu"/>'
    "</ssd:Elements></ssd:System></ssd:Elements>"
)
REFUSED: dict[str, tuple[list[tuple[str, str]], str]] = {
    "unknown_element": (
        [("</ssd:Elements>", "</ssd:Elements><ssd:Surprise/>")],
        r"must be valid by the schema of SSP 1\.0: line \d+: Element 'Surprise': This element is not",
    ),
    "unknown_attribute": ([('kind="input"', 'kind="input" colour="red"')], "The attribute 'colour' is not allowed"),
    "unknown_kind": ([('kind="input"', 'kind="sideways"')], "The value 'sideways' is not an element of the set"),
    "version_3": (
        [('version="1.0" name', 'version="3.0" name')],
        r"must be of SSP 1\.0 or 2\.0, its version, got '3\.0'",
    ),
    "next_version": ([('version="1.0" name', 'version="1.1" name')], r"of SSP 1\.0 or 2\.0, its version, got '1\.1'"),
    "not_xml": ([("</ssd:System>", "")], "is not well-formed XML"),
    "nested_system": ([("</ssd:Elements>", NESTED)], "nested systems are not supported, got 'inner'"),
    "dictionary": (
        [("</ssd:Elements>", '<ssd:SignalDictionaryReference name="d" dictionary="e"/></ssd:Elements>')],
        "signal dictionaries are not supported, got 'd'",
    ),
    "system_connector": (
        [("<ssd:Elements>", '<ssd:Connectors><ssd:Connector name="f" kind="input"/></ssd:Connectors><ssd:Elements>')],
        "connectors of the system are not supported",
    ),
    "transformation": (
        [
            (
                FIRST,
                wire("source.y_target[1]", "feedforward.y_target[1]").replace(
                    " />",
                    "><ssc:BooleanMappingTransformation><ssc:MapEntry source='true' target='false'/>"
                    "</ssc:BooleanMappingTransformation></ssd:Connection>",
                ),
            )
        ],
        r"a BooleanMappingTransformation is not supported, got 'y_target\[1\]'",
    ),
    "mapping_outside": (
        [
            (
                r'source="resources/plant.ssv" />',
                'source="resources/plant.ssv"><ssd:ParameterMapping source="../a.ssm"/></ssd:ParameterBinding>',
            )
        ],
        "must be a path inside the package",
    ),
    "model_exchange": (
        [('implementation="CoSimulation"', 'implementation="ModelExchange"')],
        "must be an FMU for co-simulation, got 'ModelExchange'",
    ),
    "other_component": (
        [("application/x-fmu-sharedlibrary", "application/x-ssp-package")],
        "must be an FMU for co-simulation, got 'application/x-ssp-package'",
    ),
    "missing_fmu": (
        [("resources/BeamPlant.fmu", "resources/Beam.fmu")],
        r"Component plant source must be a file in the package, got 'resources/Beam\.fmu'",
    ),
    "fmu_outside": ([("resources/BeamPlant.fmu", "../../BeamPlant.fmu")], "must be a path inside the package"),
    "fmu_outside_quoted": ([("resources/BeamPlant.fmu", "%2e%2e/BeamPlant.fmu")], "must be a path inside the package"),
    "fmu_by_its_place": ([("resources/BeamPlant.fmu", "/etc/passwd")], "must be a path inside the package"),
    "fmu_by_address": (
        [("resources/BeamPlant.fmu", "http://example.org/BeamPlant.fmu")],
        "must be a path inside the package",
    ),
    "fmu_by_file_address": ([("resources/BeamPlant.fmu", "file:///etc/passwd")], "must be a path inside the package"),
    "missing_set": ([("resources/plant.ssv", "resources/plants.ssv")], "must be a file in the package"),
    "set_outside": ([("resources/plant.ssv", "../plant.ssv")], "must be a path inside the package"),
    "two_of_name": (
        [('<ssd:Component name="plant"', '<ssd:Component name="controller"')],
        "must have a name of its own, got 'controller'",
    ),
    "two_connectors": (
        [(r'name="u\[1\]" kind="input"', 'name="force[1]" kind="input"')],
        r"must have each connector once, got 'force\[1\]'",
    ),
    "lost_connector": (
        [(r'name="u\[1\]" kind="input"', 'name="v" kind="input"')],
        r"must join connectors of components, got 'plant\.u\[1\]'",
    ),
    "unknown_variable": (
        [
            (r'startConnector="y_pm\[1\]"', 'startConnector="y_pn"'),
            (r'name="y_pm\[1\]" kind="output"', 'name="y_pn" kind="output"'),
        ],
        "plant.y_pn is not a variable of its FMU; did you mean 'y_p",
    ),
    "other_causality": (
        [(FIRST, ""), (r'name="y_target\[1\]" kind="input"', 'name="y_target[1]" kind="output"')],
        r"feedforward\.y_target\[1\] is an output in the package and input in its FMU",
    ),
    "from_output_to_output": ([(FIRST, wire("plant.y_pi[1]", "plant.y_pm[1]"))], "must join an output and an input"),
    "two_drivers": (
        [(FIRST, wire("controller.u[1]", "plant.u[1]"))],
        r"must not drive an input that is driven already, got 'plant\.u\[1\]'",
    ),
    "other_type": (
        [(r'(name="y_pi\[1\]" kind="output">\s*)<ssc:Real[^>]*/>', r"\1<ssc:Integer/>")],
        r"plant\.y_pi\[1\] is Integer in the package and Real in its FMU",
    ),
    "other_unit": (
        [(r'(name="y_pi\[1\]" kind="output">\s*)<ssc:Real[^>]*/>', r'\1<ssc:Real unit="V"/>')],
        r"plant\.y_pi\[1\] has the unit 'V' in the package and 'm' in its FMU",
    ),
    "units_of_connection": (
        [(FIRST, wire("source.force[1]", "feedforward.y_target[1]"))],
        r"source\.force\[1\] to feedforward\.y_target\[1\] cannot be converted: the units 'N' and 'm' are of different",
    ),
    "stop_time": ([('stopTime="0.1"', 'stopTime="INF"')], "DefaultExperiment stopTime must be finite"),
    "uneven_stop_time": ([('stopTime="0.1"', 'stopTime="0.10013"')], "stop_time must be a whole number of steps"),
    "entity": ([(r"\?>", '?><!DOCTYPE a [<!ENTITY b "c">]>')], "must have no document type declaration"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_supported_is_refused_in_one_line(
    case: str, shop: Shop, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    changes, message = REFUSED[case]
    path = shop.changed("bad", *changes)
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(path)]) == 2
    error = capsys.readouterr().err
    assert re.search(message, error), error
    assert error.count("\n") == 1
    assert error.startswith(f"flexbeams: {path}: ")
    left = sorted(p.name for p in tmp_path.rglob("*"))
    assert left in (["temporary"], ["bad", "results", "temporary"])  # a folder for results, where a run may begin


@pytest.mark.parametrize(
    ("name", "replacement", "message"),
    [
        ("resources__BeamPlant_fmu", b"nothing", "must be an FMU .is not a readable archive"),
        ("SystemStructure_ssd", None, "SystemStructure.ssd must be in the package"),
        ("resources__plant_ssv", b"<a/>", "resources/plant.ssv must be valid by the schema of SSP 1.0: line 1"),
        ("resources__plant_ssv", b"<a", "resources/plant.ssv: is not well-formed XML"),
    ],
)
def test_damaged_parts_are_refused(name: str, replacement: bytes | None, message: str, shop: Shop) -> None:
    path = shop.changed("damaged", **{name: replacement})
    with pytest.raises(InputError, match=message):
        run_package(path, shop.settings)
    assert len(package_problems(path)) == 1


def test_an_fmu_of_another_kind_is_refused(shop: Shop) -> None:
    for version, inside in (("3.0", "<CoSimulation/>"), ("2.0", "<ModelExchange/>")):
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w") as archive:
            archive.writestr(
                "modelDescription.xml", f'<fmiModelDescription fmiVersion="{version}">{inside}</fmiModelDescription>'
            )
        path = shop.changed("kind", resources__BeamPlant_fmu=buffer.getvalue())
        with pytest.raises(InputError, match=r"Component plant source must be an FMI 2\.0 co-simulation unit"):
            run_package(path, shop.settings)


def test_a_set_s_values_must_fit_their_variables(shop: Shop) -> None:
    name, place = r'(name="beam\[1\]\.tip_mass">\s*)<ssv:Real value="[^"]*" unit="kg" />', "resources/plant.ssv"
    for value, message in (
        ('<ssv:Real value="-1"/>', r"plant\.beam\[1\]\.tip_mass must be finite and from 0 to 10000"),
        ('<ssv:Real value="INF"/>', "must be finite"),
        ('<ssv:Boolean value="1"/>', "is Boolean in the parameter set and Real in its FMU"),
        ('<ssv:Real value="1" unit="m"/>', "has the unit 'm' in the parameter set and 'kg'"),
        ('<ssv:Enumeration value="1"/>', "is Enumeration in the parameter set and Real in its FMU"),
        ('<ssv:Binary value="01"/>', "must be one of Real, Integer, Boolean, String, Enumeration"),
    ):
        with pytest.raises(InputError, match=message):
            run_package(shop.changed("values", (name, r"\1" + value), where=place), shop.settings)
    notes: list[str] = []
    ignored = shop.changed("values", (r"beam\[1\]\.tip_mass", "beam[9].tip_mass"), where=place)
    run_package(ignored, shop.settings, Observer(notify=notes.append))
    assert any("plant.beam[9].tip_mass is ignored, it is not a variable of its FMU" in note for note in notes)


def test_validation_tells_of_everything_at_once(shop: Shop, capsys: pytest.CaptureFixture[str]) -> None:
    path = shop.changed("several", REFUSED["other_unit"][0][0], REFUSED["units_of_connection"][0][0])
    assert main(["validate", str(path)]) == 1
    assert capsys.readouterr().out.count("\n") == 2
    path = shop.changed(
        "starts", (r'(name="beam\[1\]\.tip_mass">\s*<ssv:Real value=)"[^"]*"', r'\1"0.5"'), where="resources/plant.ssv"
    )
    notes: list[str] = []
    assert package_problems(path, notes.append) == []
    (note,) = notes
    assert re.fullmatch(r"plant\.beam\[1\]\.tip_mass is 0\.5 in the parameter set and 0\.\d+ in its FMU", note)
    assert main(["validate", str(shop.package)]) == 0


def test_parameter_sets_are_applied(shop: Shop) -> None:
    """Inline or in a file, of the component or of the system, the system's last."""

    def end(path: Path) -> float:
        run = run_package(path, shop.settings).recording
        return float(run.values[-1, run.columns.index("plant.y_pi[1]")])

    def inline(name: str) -> str:
        return (
            '<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version="1.0" '
            f'name="p"><ssv:Parameters><ssv:Parameter name="{name}"><ssv:Real value="0.5"/></ssv:Parameter>'
            "</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding>"
            "</ssd:ParameterBindings>"
        )

    own = end(shop.package)
    file = shop.changed(
        "file", (r'(name="beam\[1\]\.tip_mass">\s*<ssv:Real value=)"[^"]*"', r'\1"0.5"'), where="resources/plant.ssv"
    )
    bindings = r'<ssd:ParameterBindings>\s*<ssd:ParameterBinding [^>]*/plant.ssv" />\s*</ssd:ParameterBindings>'
    component = shop.changed("component", (bindings, inline("beam[1].tip_mass")))
    system = shop.changed("system", ("<ssd:Elements>", inline("plant.beam[1].tip_mass") + "<ssd:Elements>"))
    values = {end(file), end(component), end(system)}
    assert len(values) == 1
    assert values != {own}
    assert end(shop.changed("lost", ("<ssd:Elements>", inline("plan.beam[1].tip_mass") + "<ssd:Elements>"))) == own


def test_ssp_2(shop: Shop, tmp_path: Path) -> None:
    """A package of SSP 2.0 has the namespaces of 1.0 and another version in each document; it runs like that of 1.0."""
    package = export_ssp(str(shop.scenario), tmp_path / "two.ssp", shop.settings, ssp_version="2.0")
    with zipfile.ZipFile(package) as archive:
        entries = {n: archive.read(n) for n in archive.namelist()}
    assert entries.keys() == shop.entries.keys()
    changed = {n for n in entries if entries[n] != shop.entries[n]}
    assert changed == {n for n in entries if n.endswith((".ssd", ".ssv"))}
    for name in changed:
        assert entries[name] == shop.entries[name].replace(b'version="1.0" name', b'version="2.0" name')
    assert package_problems(package) == []
    runs = [run_package(path, shop.settings).recording for path in (shop.package, package)]
    np.testing.assert_array_equal(runs[0].values, runs[1].values)


def test_the_step_comes_from_an_annotation_the_units_or_the_command_line(shop: Shop) -> None:
    own, osp, oms = ("<flexbeams:Run [^>]*/>", "<osp:FixedStepAlgorithm [^>]*/>", "<oms:FixedStepMaster [^>]*/>")
    half = shop.changed("half", (own, '<flexbeams:Run stepSize="1e-4"/>'))
    assert run_package(half, shop.settings).recording.steps == 1000
    half = shop.changed("half", (own, ""), (osp, '<osp:FixedStepAlgorithm baseStepSize="1e-4"/>'))
    assert run_package(half, shop.settings).recording.steps == 1000
    half = shop.changed("half", (own, ""), (osp, ""), (oms, '<oms:FixedStepMaster stepSize="1e-4"/>'))
    assert run_package(half, shop.settings).recording.steps == 1000
    attribute = 'fixedStepSize="[^"]*"'
    half = shop.changed("half", (own, ""), (osp, ""), (oms, ""), (attribute, 'fixedStepSize="1e-4"'))
    assert run_package(half, shop.settings).recording.steps == 1000
    silent = shop.changed("silent", (own, ""), (osp, ""), (oms, ""), (attribute, ""))
    assert run_package(silent, shop.settings).recording.steps == 500
    assert main(["run", str(silent), "--step", "5e-4", "--out", str(shop.folder / "out")]) == 0
    assert np.diff(read_results(shop.folder / "out/results.csv").time) == pytest.approx(np.full(200, 5e-4))


def test_options_of_a_run_hold_for_packages(shop: Shop, capsys: pytest.CaptureFixture[str]) -> None:
    out = shop.folder / "options"
    assert (
        main(
            [
                "run",
                str(shop.package),
                "--out",
                str(out),
                "--set",
                "plant.beam[1].tip_mass=0.5",
                "--stop-time",
                "0.05",
                "--decimate",
                "10",
                "--coupling",
                "gauss-seidel",
            ]
        )
        == 0
    )
    recording = read_results(out / "results.csv")
    assert recording.time == pytest.approx(np.arange(26) * 10 * STEP)
    assert "source.force[1]" in recording.columns
    assert capsys.readouterr().out.startswith("pushed: ")
    for options, message in (
        (["--structure", "kiel"], "--structure belongs to scenarios"),
        (["--basis", "segment"], "--basis belongs to scenarios"),
        (["--set", "plant.u=1"], "--set must not set an input that the scenario drives"),
        (["--set", "plan.u=1"], "--set names an unknown instance 'plan'; did you mean 'plant'"),
    ):
        assert main(["run", str(shop.package), *options]) == 2
        assert message in capsys.readouterr().err
    with pytest.raises(InputError, match="design belongs to scenarios, the units of a package are built"):
        fb.run(shop.package, design={"reduced_modes": 4})
    run = fb.run(shop.package, stop_time=0.05)
    assert run["plant.w"].shape == (251, 1, 21)
    np.testing.assert_array_equal(
        run["plant.y_pi"][::10], fb.run(shop.package, stop_time=0.05, decimate=10)["plant.y_pi"]
    )
    assert main(["run", str(shop.folder / "none.ssp")]) == 2
    assert capsys.readouterr().err == f"flexbeams: {shop.folder / 'none.ssp'}: must be a file\n"


def test_a_source_stepped_first_is_early_under_gauss_seidel_only(shop: Shop) -> None:
    """What the documentation of SignalSource says of masters that pass on new values at once."""
    source = re.search(
        r'<ssd:Component name="source".*?</ssd:Component>', shop.entries["SystemStructure.ssd"].decode(), re.DOTALL
    )
    assert source is not None
    text = source.group()
    first = shop.changed("first", (re.escape(text), ""), ("<ssd:Elements>", "<ssd:Elements>" + text))

    def run(path: Path, coupling: Any) -> Any:
        settings = Settings(record_animation=False, build_folder=shop.settings.build_folder, coupling=coupling)
        recording = run_package(path, settings).recording
        return recording.values[:, recording.columns.index("plant.y_pi[1]")]

    assert np.array_equal(run(first, "jacobi"), run(shop.package, "jacobi"))
    last, early = run(shop.package, "gauss-seidel"), run(first, "gauss-seidel")
    assert np.max(np.abs(last)) > 1e-4
    assert early[:-1] == pytest.approx(last[1:], rel=1e-3, abs=1e-3 * np.max(np.abs(last)))
    assert not np.allclose(early, last, rtol=1e-3, atol=1e-3 * np.max(np.abs(last)))


LAG = """<?xml version="1.0"?>
<ssd:SystemStructureDescription version="1.0" name="lags" xmlns:ssd="{SSP}Description" xmlns:ssc="{SSP}Common"
    xmlns:ssv="{SSP}ParameterValues">
  <ssd:System name="lags"><ssd:Elements>
    <ssd:Component name="one" source="resources/the%20lag.fmu">
      <ssd:Connectors>
        <ssd:Connector name="u[1]" kind="input"/><ssd:Connector name="y[1]" kind="output"><ssc:Real/></ssd:Connector>
        <ssd:Connector name="positive" kind="output"><ssc:Boolean/></ssd:Connector>
      </ssd:Connectors>
      <ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>
        <ssv:ParameterSet version="1.0" name="own"><ssv:Parameters>
          <ssv:Parameter name="label"><ssv:String value="theirs"/></ssv:Parameter>
          <ssv:Parameter name="sluggish"><ssv:Boolean value="true"/></ssv:Parameter>
          <ssv:Parameter name="substeps"><ssv:Integer value="3"/></ssv:Parameter>
          <ssv:Parameter name="u[2]"><ssv:Real value="0.25"/></ssv:Parameter>
        </ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>
    </ssd:Component>
    <ssd:Component name="two" source="resources/the%20lag.fmu">
      <ssd:Connectors><ssd:Connector name="u[1]" kind="input"/><ssd:Connector name="y[2]" kind="output"/>
      </ssd:Connectors>
    </ssd:Component></ssd:Elements>
    <ssd:Connections>
      <ssd:Connection startElement="one" startConnector="y[1]" endElement="two" endConnector="u[1]"{more}/>
      <ssd:Connection startElement="one" startConnector="u[1]" endElement="two" endConnector="y[2]"{more}/>
    </ssd:Connections>
  </ssd:System>
</ssd:SystemStructureDescription>
""".replace("{SSP}", "http://ssp-standard.org/SSP1/SystemStructure")


def lag_package(folder: Path, more: str) -> Path:
    (fmu,) = build_python_units([lag_unit(folder / "LagUnit.fmu")])
    with zipfile.ZipFile(folder / "lags.ssp", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("SystemStructure.ssd", LAG.replace("{more}", more))
        archive.write(fmu, "resources/the lag.fmu")
    return folder / "lags.ssp"


def test_units_of_others_run(tmp_path: Path, shop: Shop, capsys: pytest.CaptureFixture[str]) -> None:
    """Without annotations, types or a stop time; one FMU for two components, with start values of every type."""
    settings = Settings(record_animation=False, build_folder=shop.settings.build_folder, stop_time=0.02)
    with pytest.raises(InputError, match=r"one\.y\[1\] to two\.u\[1\] cannot be converted: the units 'm' and 'V'"):
        run_package(lag_package(tmp_path, ""), settings)
    path = lag_package(tmp_path, ' suppressUnitConversion="true"')
    run = run_package(path, settings)
    assert (run.summary["backend"], run.summary["design_id"]) == ("python", "0123abcd")
    columns = run.recording.columns
    assert {"one.y[1]", "one.ticks", "two.positive"} <= set(columns)
    x = {name: 2.0 * np.array(x_start) for name in ("one", "two")}
    rates, counts = {"one": a / 2, "two": a}, {"one": 3, "two": 2}
    for row in run.recording.values:
        y = {name: np.array(gain) * x[name] for name in x}
        u = {"one": np.array([y["two"][1], 0.25, 0.0]), "two": np.array([y["one"][0], 0.0, 0.0])}
        for name in x:
            assert row[[columns.index(f"{name}.y[{k}]") for k in (1, 2)]] == pytest.approx(y[name], rel=1e-12)
            for _ in range(counts[name]):
                x[name] = rates[name] * x[name] + b @ u[name]
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 2
    assert "--stop-time must be given: the package has no stop time" in capsys.readouterr().err


def test_packages_run_one_after_another_and_again(shop: Shop, tmp_path: Path) -> None:
    other = tmp_path / "other.toml"
    other.write_text(PUSHED_SCENARIO.format(stop=0.06).replace("impulse = 0.01", "impulse = 0.03"))
    second = export_ssp(str(other), tmp_path / "other.ssp", shop.settings)
    runs = [run_package(path, shop.settings).recording for path in (shop.package, second, shop.package, second)]
    for one, again in zip(runs[:2], runs[2:], strict=True):
        assert np.array_equal(one.values, again.values)
    for path, recording in ((shop.scenario, runs[0]), (other, runs[1])):
        own = run_scenario(str(path), shop.settings).recording
        assert np.array_equal(own.values, recording.values[:, [recording.columns.index(c) for c in own.columns]])


def loaded(folder: Path, name: str) -> UnitInstance:
    unit = UnitInstance(name, folder, fmpy.read_model_description(str(folder)), print)
    unit.call("setupExperiment")
    unit.call("enterInitializationMode")
    unit.call("exitInitializationMode")
    return unit


def test_units_of_two_packages_live_side_by_side(shop: Shop, tmp_path: Path) -> None:
    """Both have a BeamPlant of one name with other contents; neither sees the other's."""
    settings = Settings(
        record_animation=False, build_folder=shop.settings.build_folder, overrides={"plant.beam[1].tip_mass": 0.5}
    )
    heavy = export_ssp(str(shop.scenario), tmp_path / "heavy.ssp", settings)
    folders = []
    for k, path in enumerate((shop.package, heavy, shop.package)):
        fmpy.extract(str(path), unzipdir=str(tmp_path / f"package{k}"))
        folders.append(
            Path(
                fmpy.extract(
                    str(tmp_path / f"package{k}/resources/BeamPlant.fmu"), unzipdir=str(tmp_path / f"plant{k}")
                )
            )
        )

    def walk(units: list[UnitInstance]) -> list[list[float]]:
        rows = pushed_in_turn(units, "force[1]", "y_pi[1]")
        for unit in units:
            unit.close()
        return rows

    alone = [walk([loaded(folder, "plant")])[0] for folder in folders[:2]]
    together = walk([loaded(folder, f"plant{k}") for k, folder in enumerate(folders)])
    assert together == [*alone, alone[0]]
    assert alone[0] != alone[1]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_memory_is_flat_over_runs(shop: Shop) -> None:
    settings = Settings(record_animation=False, build_folder=shop.settings.build_folder, stop_time=0.002)
    expected = run_package(shop.package, settings).recording.values
    for _ in range(9):
        run_package(shop.package, settings)
    before = resident()
    for _ in range(CYCLES):
        assert np.array_equal(run_package(shop.package, settings).recording.values, expected)
    assert resident() - before < ALLOCATOR_NOISE


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_memory_is_flat_over_loading_and_unloading(shop: Shop, tmp_path: Path) -> None:
    fmpy.extract(str(shop.package), unzipdir=str(tmp_path / "package"))
    folders = [
        Path(fmpy.extract(str(file), unzipdir=str(tmp_path / file.stem)))
        for file in sorted((tmp_path / "package/resources").glob("*.fmu"))
    ]
    order = np.random.default_rng(7)

    def cycle() -> None:
        units = [loaded(folders[k], folders[k].name) for k in order.permutation(len(folders))]
        for unit in units:
            unit.step(0.0, STEP)
        for k in order.permutation(len(units)):
            units[k].close()

    for _ in range(50):  # until the tables of the interpreter and of the allocator have their sizes
        cycle()
    mapped = sum("/package" in line or ".so" in line for line in Path("/proc/self/maps").read_text().splitlines())
    before = resident()
    for _ in range(4 * CYCLES):
        cycle()
    assert resident() - before < ALLOCATOR_NOISE
    lines = Path("/proc/self/maps").read_text().splitlines()
    assert sum("/package" in line or ".so" in line for line in lines) <= mapped
