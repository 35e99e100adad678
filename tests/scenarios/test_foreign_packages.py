"""Third-party SSP packages: names, parameter sets and mappings, transformations, times, as SSP 1.0 has them."""

import os
import sys
import time
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.processes.guarded import GuardedFailure, guarded
from flexbeams.scenarios.processes.pools import ProcessPool
from flexbeams.scenarios.results.run import Run
from flexbeams.scenarios.runs.files import write_run
from flexbeams.scenarios.runs.observer import Observer
from flexbeams.scenarios.runs.package import run_package
from flexbeams.scenarios.validation.package import package_problems
from tests.scenarios.test_foreign_units import GAIN, KELVIN, RULES, SENSOR
from tests.units.foreign.unit import ForeignUnit

pytestmark = pytest.mark.native

SSP = "http://ssp-standard.org/SSP1/SystemStructure"
SPACES = "".join(f' xmlns:{p}="{SSP}{n}"' for p, n in (("ssd", "Description"), ("ssc", "Common"))) + "".join(
    f' xmlns:{p}="{SSP}{n}"' for p, n in (("ssv", "ParameterValues"), ("ssm", "ParameterMapping"))
)
GAINS, SENSORS, KELVINS = (
    ForeignUnit(variables=GAIN, rules=RULES),
    ForeignUnit(variables=SENSOR, dependencies={}),
    ForeignUnit(variables=KELVIN),
)


def parameters(text: str, mapping: str = "") -> str:
    """Bindings with a set inside."""
    return (
        '<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version="1.0" name="p">'
        f"<ssv:Parameters>{text}</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues>{mapping}"
        "</ssd:ParameterBinding></ssd:ParameterBindings>"
    )


def value(name: str, kind: str, text: str, more: str = "") -> str:
    return f'<ssv:Parameter name="{name}"><ssv:{kind} value="{text}" {more}/></ssv:Parameter>'


def entry(source: str, target: str, inside: str = "") -> str:
    return f'<ssm:MappingEntry source="{source}" target="{target}">{inside}</ssm:MappingEntry>'


class Shop:
    """Packages of third-party units in a folder, and their runs."""

    def __init__(self, folder: Path, build_folder: Path) -> None:
        self.folder, self.settings, self.notes = folder, Settings(build_folder=build_folder), list[str]()

    def package(
        self,
        components: Mapping[str, tuple[ForeignUnit, str]],
        connections: str = "",
        start: str = "0",
        more: str = "",
        stop: str = "0.05",
    ) -> Path:
        """A package of components (unit and bindings) by name."""
        path = self.folder / "case.ssp"
        elements = ""
        wires = f"<ssd:Connections>{connections}</ssd:Connections>" if connections else ""
        with zipfile.ZipFile(path, "w") as archive:
            for k, (name, (unit, bindings)) in enumerate(components.items()):
                archive.write(unit.write(self.folder / "unit.fmu"), f"resources/unit{k}.fmu")
                connectors = "".join(
                    f'<ssd:Connector name={quoteattr(v.name)} kind="{v.causality}"/>'
                    for v in unit.variables
                    if v.causality in ("input", "output")
                )
                elements += (
                    f'<ssd:Component name="{name}" type="application/x-fmu-sharedlibrary" '
                    f'source="resources/unit{k}.fmu">'
                    f"<ssd:Connectors>{connectors}</ssd:Connectors>{bindings}</ssd:Component>"
                )
            archive.writestr(
                "SystemStructure.ssd",
                f'<ssd:SystemStructureDescription{SPACES} version="1.0" name="case"><ssd:System name="root">{more}'
                f"<ssd:Elements>{elements}</ssd:Elements>{wires}</ssd:System>"
                f'<ssd:DefaultExperiment startTime="{start}" stopTime="{stop}"/></ssd:SystemStructureDescription>',
            )
        return path

    def run(self, path: Path) -> Run:
        self.notes.clear()
        return run_package(path, self.settings, Observer(notify=self.notes.append))

    def last(self, path: Path) -> dict[str, float]:
        recording = self.run(path).recording
        return dict(zip(recording.columns, recording.values[-1].tolist(), strict=True))


@pytest.fixture
def shop(tmp_path: Path, run_folder: Path) -> Shop:
    return Shop(tmp_path, run_folder / "build/fmus")


def connection(start: str, end: str, inside: str = "", more: str = "") -> str:
    (a, x), (b, y) = start.rsplit(".", 1), end.rsplit(".", 1)
    ends = f'startElement="{a}" startConnector="{x}" endElement="{b}" endConnector="{y}"'
    return f"<ssd:Connection {ends} {more}>{inside}</ssd:Connection>"


def test_components_may_have_any_names(shop: Shop) -> None:
    names = ("1st.part-a", "1st", "the gain/../x")
    path = shop.package(
        {names[0]: (SENSORS, ""), names[1]: (SENSORS, ""), names[2]: (GAINS, "")},
        connection(f"{names[0]}.x[1]", f"{names[2]}.u[1]") + connection(f"{names[0]}.count", f"{names[2]}.k"),
    )
    values = shop.last(path)
    assert (values["the gain/../x.y[1]"], values["the gain/../x.n"]) == (1000.0, 14.0)
    assert "1st.part-a.x[1] to the gain/../x.u[1] is converted from m to mm by the factor 1000" in shop.notes
    assert package_problems(path) == []


def test_parameters_of_each_type_with_blanks_and_ignored_ones(shop: Shop) -> None:
    own = parameters(
        value("b", "Boolean", " true ")
        + value("mode", "Enumeration", "on")
        + value("label", "String", " two ")
        + value("k", "Integer", " 4 ")
        + value("u[1]", "Real", "0.003", 'unit="m"')
        + value("gain", "Integer", "3")
        + value("unknown", "Real", "1")
    )
    system = parameters(value("g.k", "Integer", "5") + value("h.k", "Integer", "6"))
    values = shop.last(shop.package({"g": (GAINS, own)}, more=system))
    assert (values["g.c"], values["g.shown"], values["g.letters"], values["g.n"]) == (0.0, 2.0, 5.0, 10.0)
    assert (values["g.y[1]"], values["g.seen"]) == (3.0, 3.0)
    assert [note.split(",")[0] for note in shop.notes] == [
        "h.k is ignored",
        "g.u[1] is converted from m to mm",
        "g.unknown is ignored",
    ]


def test_a_mapping_names_and_transforms_parameters(shop: Shop) -> None:
    mapping = (
        '<ssd:ParameterMapping><ssm:ParameterMapping version="1.0">'
        + entry("a", "u[1]", '<ssc:LinearTransformation factor="2" offset="1"/>')
        + entry("a", "gain")
        + entry("missing", "k")
        + "</ssm:ParameterMapping></ssd:ParameterMapping>"
    )
    own = parameters(value("a", "Real", "4") + value("u[2]", "Real", "7"), mapping)
    values = shop.last(shop.package({"g": (GAINS, own)}))
    assert (values["g.y[1]"], values["g.y[2]"], values["g.seen"], values["g.n"]) == (9.0, 0.0, 4.0, 2.0)


def test_mappings_follow_the_conversion_of_units(shop: Shop) -> None:
    """u[1] is in mm: 2 (1000 x 0.003) + 1; without conversion 2 x 0.003 + 1."""
    for more, expected in (("", 7.0), ('suppressUnitConversion="1"', 1.006)):
        inside = '<ssc:LinearTransformation factor="2" offset="1"/>'
        listed = entry("a", "u[1]", inside).replace("<ssm:MappingEntry", f"<ssm:MappingEntry {more}")
        mapping = (
            '<ssd:ParameterMapping><ssm:ParameterMapping version="1.0">'
            f"{listed}</ssm:ParameterMapping></ssd:ParameterMapping>"
        )
        own = parameters(value("a", "Real", "0.003", 'unit="m"'), mapping)
        assert shop.last(shop.package({"g": (GAINS, own)}))["g.y[1]"] == pytest.approx(expected, rel=1e-15)


def test_parameters_of_the_system_go_to_the_component_of_the_longest_name(shop: Shop) -> None:
    system = parameters(value("1st.part-a.k", "Integer", "5") + value("1st.k", "Integer", "6"))
    values = shop.last(shop.package({"1st": (GAINS, ""), "1st.part-a": (GAINS, "")}, more=system))
    assert (values["1st.part-a.n"], values["1st.n"]) == (10.0, 12.0)
    assert not shop.notes


def test_transformations_follow_the_conversion_of_units(shop: Shop) -> None:
    linear = '<ssc:LinearTransformation factor="2" offset="5"/>'
    units = {"s": (SENSORS, ""), "g": (GAINS, "")}
    values = shop.last(shop.package(units, connection("s.x[1]", "g.u[1]", linear)))
    assert values["g.y[1]"] == 2005.0
    off = 'suppressUnitConversion=" true "'
    assert shop.last(shop.package(units, connection("s.x[1]", "g.u[1]", linear, off)))["g.y[1]"] == 7.0
    assert shop.last(shop.package(units, connection("s.x[1]", "g.u[1]", more=off)))["g.y[1]"] == 1.0
    with pytest.raises(InputError, match="has a linear transformation, which Integer does not take"):
        shop.run(shop.package(units, connection("s.count", "g.k", linear)))


def test_a_connection_may_name_its_input_first(shop: Shop) -> None:
    units = {"s": (SENSORS, ""), "g": (GAINS, "")}
    wires = connection("g.u[1]", "s.x[1]") + connection("s.x[2]", "g.u[2]")
    values = shop.last(shop.package(units, wires))
    assert (values["g.y[1]"], values["g.y[2]"]) == (1000.0, 20000.0)
    with pytest.raises(InputError, match=r"must not drive an input that is driven already, got 'g\.u\[1\]'"):
        shop.run(shop.package(units, wires + connection("s.x[2]", "g.u[1]")))
    both = {**units, "h": (GAINS, "")}
    wires = connection("s.x[1]", "g.u[1]") + connection("s.x[1]", "h.u[1]")  # one output may drive several inputs
    values = shop.last(shop.package(both, wires))
    assert (values["g.y[1]"], values["h.y[1]"]) == (1000.0, 1000.0)


def test_units_that_disagree_on_the_step_need_an_option(shop: Shop) -> None:
    path = shop.package({"g": (GAINS, ""), "s": (replace(SENSORS, step="0.025"), "")})
    with pytest.raises(InputError, match="--step must be given: neither the package nor its units agree on a step"):
        shop.run(path)
    shop.settings = replace(shop.settings, step=0.025)
    assert shop.run(path).recording.time.tolist() == [0.0, 0.025, 0.05]
    shop.settings = replace(shop.settings, step=None)
    equal = shop.package({"g": (replace(GAINS, step="0.025"), ""), "s": (replace(SENSORS, step="0.025"), "")})
    assert len(shop.run(equal).recording.time) == 3


def test_a_run_begins_at_the_start_time(shop: Shop) -> None:
    clock = ForeignUnit(variables=[v for v in GAIN if v.name in ("seen", "u[1]")], rules=["clock 5"])
    run = shop.run(shop.package({"g": (clock, "")}, start="2.0", stop="2.05"))
    assert run.recording.time.tolist() == [2.0 + k * 0.01 for k in range(6)]
    assert run.recording.values[:, 0].tolist() == pytest.approx(run.recording.time.tolist(), abs=1e-12)
    with pytest.raises(InputError, match=r"stop_time must be finite and > 2, the start time, got 1\.0"):
        shop.run(shop.package({"g": (clock, "")}, start="2.0", stop="1.0"))


def test_a_package_that_sets_parameters_is_valid(shop: Shop, capsys: pytest.CaptureFixture[str]) -> None:
    path = shop.package({"g": (GAINS, parameters(value("gain", "Real", "3")))})
    assert main(["validate", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines == [f"{path}: valid", f"{path}: note: g.gain is 3.0 in the parameter set and 2 in its FMU"]


REFUSED = {
    "text": (value("gain", "Real", "3", 'unit="V"'), "has the unit 'V' in the parameter set and"),
    "item": (value("mode", "Enumeration", "onn"), "must be an item; did you mean 'on'?"),
    "output": (value("y[1]", "Real", "3"), "is output in its FMU and cannot take a start value"),
    "type": (value("k", "Boolean", "true"), "is Boolean in the parameter set and Integer in its FMU"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_parameters_that_do_not_fit_are_refused(case: str, shop: Shop) -> None:
    text, complaint = REFUSED[case]
    variables = [v for v in GAIN if v.name != "gain"]
    variables.insert(0, replace(GAIN[0], unit="mm"))
    path = shop.package({"g": (ForeignUnit(variables=variables, rules=RULES), parameters(text))})
    with pytest.raises(InputError) as error:
        shop.run(path)
    assert complaint in str(error.value)
    assert len(package_problems(path)) == 1


@pytest.mark.parametrize(
    ("rule", "complaint"),
    [
        ("crash step", "crashed (SIGABRT)"),
        ("exit instantiate", "ended its process with the exit status 0"),
        ("hang step", "made no progress for 3 s (see --patience)"),
    ],
)
@pytest.mark.skipif(sys.platform == "win32", reason="no signals")
def test_code_that_ends_or_hangs_is_one_line(
    rule: str, complaint: str, shop: Shop, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(shop.folder)
    path = shop.package({"g": (ForeignUnit(variables=GAIN, rules=[*RULES, rule]), "")})
    build = ["--cache", str(shop.settings.build_folder)]
    assert main(["run", str(path), "--out", "results", "--patience", "3" if "hang" in rule else "60", *build]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == f"{path} was not written by flexbeams; its units run in a process of their own"
    assert lines[-1] == f"flexbeams: the code of a unit {complaint}"


@pytest.mark.skipif(sys.platform == "win32", reason="no signals")
def test_fmus_that_a_scenario_names_run_in_a_process_of_their_own(
    shop: Shop, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the scenario or in the one that it is compared with; a failure leaves nothing behind."""
    monkeypatch.chdir(shop.folder)
    seen = [v for v in GAIN if v.name == "seen"]
    scenario = 'title = "one"\nstructure = "single_beam"\nstop_time = 0.05\nstep = 0.01\n{}[instance.g]\nfmu = "{}"\n'
    ForeignUnit(variables=seen, rules=["clock 5", "crash step"]).write(shop.folder / "bad.fmu")
    ForeignUnit(variables=seen, rules=["clock 5"]).write(shop.folder / "good.fmu")
    (shop.folder / "bad.toml").write_text(scenario.format("", "bad.fmu"))
    (shop.folder / "compared.toml").write_text(scenario.format('open_loop = "bad.toml"\n', "good.fmu"))
    (shop.folder / "good.toml").write_text(scenario.format("", "good.fmu"))
    options = ["--no-figures", "--no-report", "--cache", str(shop.settings.build_folder)]
    for name in ("bad", "compared"):
        assert main(["run", f"{name}.toml", *options]) == 2
        assert capsys.readouterr().err.splitlines()[-1] == "flexbeams: the code of a unit crashed (SIGABRT)"
        assert not Path("results").exists()
    assert main(["run", "good.toml", *options]) == 0
    assert Path("results/good/results.csv").read_text().startswith("time,g.seen\n0.0,0.0\n0.01,0.01\n")


def test_a_truncated_library_ends_with_one_line(
    shop: Shop, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(shop.folder)
    path = shop.package({"g": (GAINS, "")})
    with zipfile.ZipFile(path) as archive:
        entries = {n: archive.read(n) for n in archive.namelist()}
    with zipfile.ZipFile(shop.folder / "unit.fmu") as archive:
        inside = {n: archive.read(n) for n in archive.namelist()}
    with zipfile.ZipFile(shop.folder / "unit.fmu", "w") as archive:
        for name, content in inside.items():
            archive.writestr(name, content[: len(content) // 2] if name.startswith("binaries/") else content)
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in entries.items():
            archive.writestr(name, (shop.folder / "unit.fmu").read_bytes() if name.endswith(".fmu") else content)
    assert main(["run", str(path), "--out", "results", "--cache", str(shop.settings.build_folder)]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("flexbeams: ")


def test_a_run_of_a_package_has_a_report(shop: Shop, tmp_path: Path) -> None:
    path = shop.package({"s": (SENSORS, ""), "g": (GAINS, "")}, connection("s.x[1]", "g.u[1]"))
    write_run(shop.run(path), tmp_path / "out")
    page = (tmp_path / "out/report.html").read_text()
    assert "g.y" in page
    assert "s (unit0.fmu), g (unit1.fmu)" in page


def leave() -> None:
    os._exit(3)


def be_interrupted() -> None:
    """Ctrl-C that comes while a process starts."""
    with ProcessPool(1) as pool:
        pool.submit(time.sleep, 60)
        raise KeyboardInterrupt


@pytest.mark.skipif(sys.platform == "win32", reason="no signals")
def test_guarded_calls() -> None:
    assert guarded(divmod, 7, 2) == (3, 1)
    with pytest.raises(GuardedFailure, match=r"the code of a unit crashed \(SIGABRT\)"):
        guarded(os.abort)
    with pytest.raises(GuardedFailure, match="ended its process with the exit status 3"):
        guarded(leave)
    with pytest.raises(GuardedFailure, match=r"did not return within 1 s"):
        guarded(time.sleep, 60, patience=1.0)
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        be_interrupted()
    assert time.monotonic() - begin < 50
