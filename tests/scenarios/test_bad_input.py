"""What a user can get wrong: exit status 2, one line that names file, key, rule and value, and nothing written."""

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from flexbeams.fmus.packaging.python import build_python_units
from flexbeams.fmus.units.catalogue import CATALOGUE
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.scenario_file import structure_files
from tests.helpers import LOOP_WIRES, Workshop
from tests.units import lag_interface as lag

Write = Callable[[str, str], Path]
Refused = Callable[..., str]

LOOP = (
    """title = "Loop"
structure = "kiel"
stop_time = 0.02
[instance.feedforward]
unit = "FlatnessFeedforward"
start.transition_time = 0.9
[instance.controller]
unit = "TrackingController"
[instance.plant]
unit = "BeamPlant"
"""
    + LOOP_WIRES
    + """[[input]]
to = "feedforward.y_target"
targets = [{ time = 0.001, value = [-8e-3, 1e-3, 4e-3, -6e-3] }]
"""
)


@pytest.fixture
def refused(at_run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Refused:
    """Runs the command, which must refuse; returns its one line without the command's name, and not what it builds."""

    def refuse(*arguments: object) -> str:
        out = tmp_path / "results"
        assert main(["run", *map(str, arguments), "--out", str(out)]) == 2
        shown = capsys.readouterr()
        assert shown.out == ""
        assert not out.exists()
        [line] = [line for line in shown.err.splitlines() if not line.startswith("building ")]
        assert line.startswith("flexbeams: ")
        assert "Traceback" not in line
        return line.removeprefix("flexbeams: ")

    return refuse


def check(**keys: str) -> str:
    """A check with these keys, values as TOML text."""
    return (
        LOOP
        + "[[check]]\n"
        + "".join(
            f"{k} = {v}\n" for k, v in {"name": '"c"', "measure": '"largest"', "of": '"plant.y_pi"', **keys}.items()
        )
    )


def swapped(old: str, new: str) -> str:
    assert LOOP.count(old) == 1, old
    return LOOP.replace(old, new)


SCENARIOS = {
    # keys
    "unknown_key": ('titel = "x"\n' + LOOP, "titel is not a known key; did you mean 'title'? (valid: title, paper,"),
    "missing_key": (swapped('structure = "kiel"\n', ""), "structure is missing"),
    "empty_file": ("", "title is missing"),
    "no_instances": (LOOP[: LOOP.index("[instance")], "instance is missing"),
    "no_instance": (LOOP[: LOOP.index("[instance")] + "[instance]\n", "instance must hold at least one instance"),
    "bad_name": (
        swapped("[instance.plant]", '[instance."my plant"]'),
        "instance.my plant must be a name of letters, digits and underscores",
    ),
    "unknown_key_below": (
        swapped("start.transition_time = 0.9", "strat.preview = 1.0"),
        "instance.feedforward.strat is not a known key; did you mean 'start'?",
    ),
    "unknown_weight": (
        LOOP + "[design.weights]\nlqr_inpt = 1.0\n",
        "design.weights.lqr_inpt is not a known key; did you mean 'lqr_input'?",
    ),
    "not_toml": ("a = = 3", "is not valid TOML: Invalid value (at line 1, column 5)"),
    # types and bounds
    "text_for_number": (
        swapped("stop_time = 0.02", 'stop_time = "long"'),
        "stop_time must be a number, got 'long'",
    ),
    "stop_time_nan": (swapped("stop_time = 0.02", "stop_time = nan"), "stop_time must be finite, got nan"),
    "stop_time_inf": (swapped("stop_time = 0.02", "stop_time = inf"), "stop_time must be finite, got inf"),
    "stop_time_zero": (swapped("stop_time = 0.02", "stop_time = 0.0"), "stop_time must be finite and > 0, got 0.0"),
    "stop_time_negative": (swapped("stop_time = 0.02", "stop_time = -1"), "stop_time must be finite and > 0, got -1"),
    "step_zero": ("step = 0.0\n" + LOOP, "step must be finite and > 0, got 0.0"),
    "step_negative": ("step = -1e-3\n" + LOOP, "step must be finite and > 0, got -0.001"),
    "step_does_not_divide": (
        "step = 3e-3\n" + LOOP,
        "stop_time must be a whole number of steps of 0.003 s, got 0.02",
    ),
    "step_longer_than_run": ("step = 1.0\n" + LOOP, "stop_time must be a whole number of steps of 1 s, got 0.02"),
    "step_denormal": ("step = 1e-320\n" + LOOP, "stop_time must be a whole number of steps of 9.99989e-321 s"),
    "recording_too_large": (
        swapped("stop_time = 0.02", "stop_time = 1e9"),
        "stop_time must leave a recording that fits on the disk: 5e+12 steps make 1.44e+06 GB of values, with the "
        "files ",
    ),
    "recording_far_too_large": (
        swapped("stop_time = 0.02", "stop_time = 1e300"),
        "stop_time must leave a recording that fits on the disk",
    ),
    "unknown_coupling": (
        'coupling = "jakobi"\n' + LOOP,
        "coupling must be 'jacobi' or 'gauss-seidel'; did you mean 'jacobi'?, got 'jakobi'",
    ),
    "boolean_for_number": (
        swapped("= 0.9", "= true"),
        "instance.feedforward.start.transition_time must be of type Real, got True",
    ),
    "text_for_value": (
        swapped("= 0.9", '= "fast"'),
        "instance.feedforward.start.transition_time must be of type Real, got 'fast'",
    ),
    "table_for_value": (
        swapped("= 0.9", "= { a = 1 }"),
        "instance.feedforward.start.transition_time must be a number, got 'dict'",
    ),
    "value_out_of_bounds": (
        swapped("= 0.9", "= -1.0"),
        "instance.feedforward.start.transition_time must be from 0.001 to 10000.0, got -1.0",
    ),
    # units and variables
    "unknown_unit": (
        swapped('"BeamPlant"', '"BeamPlan"'),
        "instance.plant.unit is not a unit; did you mean 'BeamPlant'? "
        f"(valid: {', '.join(kind.name for kind in CATALOGUE)}), got 'BeamPlan'",
    ),
    "unit_and_file": (
        swapped('unit = "BeamPlant"', 'unit = "BeamPlant"\nfmu = "x.fmu"'),
        "instance.plant must have exactly one of unit and fmu",
    ),
    "basis_of_controller": (
        swapped('"TrackingController"', '"TrackingController"\nbasis = "segment"'),
        "instance.controller.basis and order belong to a BeamPlant",
    ),
    "order_too_low": (
        swapped('"BeamPlant"', '"BeamPlant"\nbasis = "segment"\norder = 2'),
        "instance.plant.order must be >= 3 for the basis segment, got 2",
    ),
    "unknown_start_value": (
        swapped("start.transition_time", "start.transition_tim"),
        "instance.feedforward.start.transition_tim is not a variable; did you mean "
        "'transition_time'? (valid: y_target, transition_time, voltage_limit, voltage_min, voltage_max, preview)",
    ),
    "start_value_of_output": (
        swapped("start.transition_time", "start.u_ff"),
        "instance.feedforward.start.u_ff is not settable",
    ),
    "too_few_start_values": (
        swapped("transition_time = 0.9", "y_target = [1e-3, 2e-3]"),
        "instance.feedforward.start.y_target must have 4 values, got [0.001, 0.002]",
    ),
    "integer_with_fraction": (
        swapped('"BeamPlant"', '"BeamPlant"\nstart.noise_seed = 1.5'),
        "instance.plant.start.noise_seed must be of type Integer, got 1.5",
    ),
    "integer_too_large": (
        swapped('"BeamPlant"', '"BeamPlant"\nstart.noise_seed = 1e12'),
        "instance.plant.start.noise_seed must be of type Integer, got 1000000000000.0",
    ),
    "unknown_family": (
        swapped('"BeamPlant"', '"BeamPlant"\nscale."sprin[].stiffness" = 1.1'),
        "instance.plant.scale.sprin[].stiffness is not a variable; did you mean 'spring[].",
    ),
    "scale_of_boolean": (
        swapped('"TrackingController"', '"TrackingController"\nscale.feedback = 2.0'),
        "instance.controller.scale.feedback must be of a Real variable, got 'Boolean'",
    ),
    "scale_negative": (
        swapped('"BeamPlant"', '"BeamPlant"\nscale."spring[].stiffness" = -1.0'),
        "instance.plant.scale.spring[].stiffness must be from 0.0 to 1000000000.0, got -7.53",
    ),
    # connections and inputs
    "unknown_instance": (
        swapped('"plant.y_pm"', '"plan.y_pm"'),
        "connection[4].from names an unknown instance 'plan'; did you mean 'plant'? (valid: "
        "feedforward, controller, plant), got 'plan.y_pm'",
    ),
    "unknown_output": (
        swapped('"plant.y_pm"', '"plant.y_mp"'),
        "connection[4].from must name an output of plant, which has no 'y_mp'; did "
        "you mean 'y_pm'? (valid: y_pi, y_pm), got 'plant.y_mp'",
    ),
    "unknown_input": (
        swapped('to = "plant.u"', 'to = "plant.v"'),
        "connection[3].to must name an input of plant, which has no 'v' (valid: u, force), got 'plant.v'",
    ),
    "input_is_output": (
        swapped('to = "plant.u"', 'to = "plant.y_pi"'),
        "connection[3].to must name an input of plant, which has no 'y_pi'",
    ),
    "unequal_sizes": (
        swapped('"plant.y_pm"', '"plant.y_pi"'),
        "connection[4] must join equal sizes: plant.y_pi has 4, controller.y_pm has 6",
    ),
    "two_signals_on_input": (
        LOOP + '[[input]]\nto = "plant.u[3]"\nconstant = 1.0\n',
        "input[2].to must not drive an input that is driven already, got 'plant.u[3]'",
    ),
    "two_kinds_of_signal": (
        LOOP + '[[input]]\nto = "plant.force"\nconstant = 1.0\nstep = { time = 1.0, value = 1.0 }\n',
        "input[2] must have exactly one of constant, step, pulse,",
    ),
    "signal_too_narrow": (
        LOOP + '[[input]]\nto = "plant.force"\nconstant = [1.0, 2.0]\n',
        "input[2] must give 3 values for plant.force, got 2",
    ),
    "pulse_duration_zero": (
        LOOP + '[[input]]\nto = "plant.force"\npulse = { time = 0, duration = 0, impulse = 1 }',
        "input[2].pulse.duration must be finite and > 0, got 0",
    ),
    # targets
    "target_out_of_reach": (
        swapped("-8e-3, 1e-3", "-80e-3, 1e-3"),
        "input[1].targets[1].value is out of reach: patch pair 1 would need 6608.9 V at rest, "
        "the limit is 1000 V, got [-0.08, 0.001, 0.004, -0.006]",
    ),
    "target_of_another_size": (
        swapped("[-8e-3, 1e-3, 4e-3, -6e-3]", "[-8e-3]"),
        "input[1].targets[1].value must have 4 values, one for each point of interest, got [-0.008]",
    ),
    "targets_out_of_order": (
        swapped("targets = [", "targets = [{ time = 2.0, value = [0.0, 0.0, 0.0, 0.0] }, "),
        "input[1].targets must have ascending times, got [2.0, 0.001]",
    ),
    "targets_empty": (
        LOOP[: LOOP.index("targets")] + "targets = []\n",
        "input[1].targets must have at least 1 entries, got []",
    ),
    # record, checks, figures
    "unknown_record": (
        'record = ["plant.enery"]\n' + LOOP,
        "record[1] must name a variable of plant, which has no 'enery'; did you mean 'energy'?",
    ),
    "record_of_text": (
        'record = ["plant.design_id"]\n' + LOOP,
        "record[1] is a String, which runs do not record, got 'plant.design_id'",
    ),
    "check_of_unknown_signal": (check(of='"plant.y_pii"'), "check[1].of is not recorded; did you mean 'plant.y_pi'"),
    "unknown_measure": (check(measure='"larges"'), "check[1].measure must be 'largest', "),
    "check_after_beyond_end": (check(after="1.0"), "check[1].after must be within the run of 0.02 s, got 1.0"),
    "check_before_beyond_end": (check(before="1.0"), "check[1].before must be within the run of 0.02 s, got 1.0"),
    "check_window_empty": (
        check(after="0.01", before="0.005"),
        "check[1].before must be >= after (0.01 s), got 0.005",
    ),
    "change_of_one_row": (
        check(measure='"largest_change"', after="0.02"),
        "check[1].after must leave more than one row of the run to look at, got 0.02",
    ),
    "points_beyond": (check(points="[5]"), "check[1].points must be from 1 to 4, got [5]"),
    "points_empty": (check(points="[]"), "check[1].points must have at least 1 entries, got []"),
    "reference_of_another_size": (
        check(reference="[1.0, 2.0]"),
        "check[1].reference must have 4 values, got [1.0, 2.0]",
    ),
    "unknown_reference": (
        check(reference='"targt"'),
        "check[1].reference must be 'zero', 'target', 'end' or 'start'; did you mean 'target'?, got 'targt'",
    ),
    "strains_against_target": (
        check(of='"plant.y_pm"', reference='"target"'),
        "check[1].of must have the 4 elements of the target, got 'plant.y_pm'",
    ),
    "relative_without_target": (
        check(relative="true", before="0.0005"),
        "check[1].relative needs a target other than zero",
    ),
    "overshoot_without_target": (
        check(measure='"overshoot_percent"'),
        "check[1].reference must not be zero for an overshoot in percent, got 'zero'",
    ),
    "limits_crossed": (check(min="2.0", max="1.0"), "check[1].min must be <= max (1), got 2.0"),
    "figure_of_unknown_signal": (
        LOOP + '[[figure]]\nfile = "a"\nrows = [["plant.y_pi", "plant.y_pii"]]\n',
        "figure[1].rows names a signal that is not recorded; did you mean 'plant.y_pi'",
    ),
    "empty_row": (
        LOOP + '[[figure]]\nfile = "a"\nrows = [[]]\n',
        "figure[1].rows[1] must have at least 1 entries, got []",
    ),
    "figure_with_path": (
        LOOP + '[[figure]]\nfile = "../a"\nrows = [["plant.y_pi"]]\n',
        "figure[1].file must match pattern '^[A-Za-z0-9_-]+$', got '../a'",
    ),
    "figure_points_beyond": (
        LOOP + '[[figure]]\nfile = "a"\nrows = [["plant.y_pi"]]\npoints = [7]\n',
        "figure[1].points must have one within plant.y_pi, got [7]",
    ),
    "open_loop_in_figure": (
        LOOP + '[[figure]]\nfile = "a"\nrows = [["open_loop.plant.y_pi"]]\n',
        "figure[1].rows needs the scenario's key open_loop",
    ),
    # other files
    "unknown_structure": (
        swapped('"kiel"', '"keil"'),
        "structure 'keil' is neither a file nor a shipped structure; did you mean 'kiel'?",
    ),
    "unknown_open_loop": (
        'open_loop = "trackin"\n' + LOOP,
        "open_loop 'trackin' is neither a file nor a shipped scenario; did you mean 'tracking'?",
    ),
    "open_loop_of_open_loop": (
        'open_loop = "disturbance"\n' + LOOP,
        "open_loop must be a scenario without an open_loop of its own, got 'disturbance'",
    ),
    "open_loop_is_itself": (
        'open_loop = "s.toml"\n' + LOOP,
        "open_loop must be a scenario without an open_loop of its own, got 's.toml'",
    ),
    "fmu_missing": (swapped('unit = "BeamPlant"', 'fmu = "none.fmu"'), "instance.plant.fmu must be a file, got '"),
    "fmu_is_folder": (swapped('unit = "BeamPlant"', 'fmu = "."'), "instance.plant.fmu must be a file, got '"),
    "fmu_is_no_archive": (swapped('unit = "BeamPlant"', 'fmu = "s.toml"'), "instance.plant.fmu must be an FMU"),
    # designs that cannot be
    "too_many_modes": (
        LOOP + "[design]\nreduced_modes = 30\n",
        "reduced_modes must be 1 to 10, modes of each beam (the model has 30 for 3 beams), got 30",
    ),
    "gevrey_order_of_two": (LOOP + "[design]\ngevrey_order = 2.0\n", "design.gevrey_order must be < 2, got 2.0"),
    "transition_too_short": (
        LOOP + "[design]\ntransition_time = 1e-9\n",
        "design.transition_time must be >= 0.001, got 1e-09",
    ),
    "integral_gain_too_large": (
        LOOP + "[design]\nintegral_gain = 2.0\n",
        "integral_gain = 2 makes the sampled loop unstable; 0.0012 still holds",
    ),
    "sample_time_of_zero": (LOOP + "[design]\nsample_time = 0\n", "design.sample_time must be finite and > 0, got 0"),
}


@pytest.mark.parametrize("case", SCENARIOS)
def test_scenario_with(case: str, refused: Refused, write_scenario: Write) -> None:
    text, complaint = SCENARIOS[case]
    path = write_scenario("s", text)
    line = refused(path)
    assert line.startswith(f"{path}: ")
    assert complaint in line


STRUCTURES = {
    "unknown_key": (
        "[[beam]]\nlength",
        "[[beam]]\nlenght",
        "beam[1].lenght is not a known key; did you mean 'length'?",
    ),
    "missing_key": ("tip_mass = 0.0202", "", "beam[1].tip_mass is missing"),
    "text_for_number": ("density = 1500.0", 'density = "heavy"', "beam[1].density must be a number, got 'heavy'"),
    "negative_length": ("length = 0.4 #", "length = -0.4 #", "beam[1].length must be finite and > 0, got -0.4"),
    "nan": ("stiffness = 7.53", "stiffness = nan", "spring[1].stiffness must be finite"),
    "overlapping_patches": (
        "position = 0.16",
        "position = 0.1",
        "patch[3].position must not overlap patch[2], which ends at 0.11 m, got 0.1",
    ),
    "overhanging_patch": (
        "position = 0.16",
        "position = 0.35",
        "patch[3].position plus length must not pass the end of beam 2 (0.4 m), got 0.435",
    ),
    "point_off_beam": (
        "position = 0.39",
        "position = 0.41",
        "point_of_interest[1].position must lie on beam 1 (0 ... 0.4 m), got 0.41",
    ),
    "gauge_off_beam": (
        "position = 0.2 #",
        "position = 0.399 #",
        "strain_gauge[2].position with its length 0.006 m must lie on beam 1",
    ),
    "unknown_beam": ("beam = 3", "beam = 4", "patch[4].beam must be a beam from 1 to 3, got 4"),
    "spring_to_unknown_beam": (
        "between = [2, 3]",
        "between = [2, 4]",
        "spring[2].between must be two adjacent beams from 1 to 3, got [2, 4]",
    ),
}


@pytest.mark.parametrize("case", STRUCTURES)
def test_structure_with(
    case: str, refused: Refused, tmp_path: Path, write_scenario: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a scenario, on the command line of a run, and in a design."""
    from flexbeams.plant.structure import find_structure

    old, new, complaint = STRUCTURES[case]
    text = find_structure("kiel").read_text(encoding="utf-8")
    assert old in text
    own = tmp_path / "own.toml"
    own.write_text(text.replace(old, new, 1), encoding="utf-8")
    assert refused(write_scenario("s", swapped('"kiel"', '"own.toml"'))).startswith(f"{own}: {complaint}")
    assert refused("tracking", "--structure", own).startswith(f"{own}: {complaint}")
    assert main(["design", "--structure", str(own)]) == 2
    assert capsys.readouterr().err.startswith(f"flexbeams: {own}: {complaint}")


OPTIONS = {
    "no_equals_sign": (["--set", "plant.u"], "must be INSTANCE.VARIABLE=VALUE, got 'plant.u'"),
    "no_instance": (["--set", "=3"], "must be INSTANCE.VARIABLE=VALUE, got '=3'"),
    "no_variable": (["--set", "plant.=3"], "--set plant. is not a variable"),
    "unknown_instance": (["--set", "plan.u=1"], "--set names an unknown instance 'plan'; did you mean 'plant'?"),
    "unknown_variable": (
        ["--set", "plant.spring[1].stifness=1"],
        "--set plant.spring[1].stifness is not a variable; did you mean 'spring[].stiffness'?",
    ),
    "output": (["--set", "plant.y_pi[1]=1"], "--set plant.y_pi[1] is not settable"),
    "text_for_number": (
        ["--set", "plant.u=high"],
        "--set plant.u must be of type Real, got 'high'",
    ),
    "nan": (["--set", "plant.force[1]=nan"], "plant.force[1] must be finite, got 'nan'"),
    "number_for_boolean": (
        ["--set", "controller.feedback=2"],
        "--set controller.feedback must be of type Boolean, got 2.0",
    ),
    "boolean_for_number": (
        ["--set", "controller.integral_gain=true"],
        "--set controller.integral_gain must be of type Real, got True",
    ),
    "out_of_bounds": (
        ["--set", "plant.beam[1].density=-1"],
        "--set plant.beam[1].density must be from 1.0 to 1000000.0, got -1.0",
    ),
    "density_zero": (
        ["--set", "plant.beam[1].density=0"],
        "plant.beam[1].density must be from 1.0 to 1000000.0, got 0.0",
    ),
    "target_out_of_reach_by_limit": (
        ["--set", "feedforward.voltage_limit=100"],
        "would need 817.0 V at rest, the limit is 100 V",
    ),
    "target_out_of_reach_by_limit_of_a_pair": (
        ["--set", "feedforward.voltage_min[2]=-500"],
        "patch pair 2 would need -770.0 V at rest, voltage_min[2] is -500 V",
    ),
    "driven_input": (
        ["--set", "plant.u[1]=1"],
        "--set must not set an input that the scenario drives, got 'plant.u[1]'",
    ),
    "stop_time_zero": (["--stop-time", "0"], "'--stop-time': 0.0 is not in the range x>0"),
    "stop_time_nan": (["--stop-time", "nan"], "'--stop-time': nan must be finite and > 0"),
    "stop_time_inf": (["--stop-time", "inf"], "'--stop-time': inf must be finite and > 0"),
    "step_nan": (["--step", "nan"], "'--step': nan must be finite and > 0"),
    "real_time_factor_inf": (["--real-time-factor", "inf"], "'--real-time-factor': inf must be finite and > 0"),
    "stop_time_text": (["--stop-time", "long"], "'long' is not a valid float"),
    "stop_time_between_steps": (
        ["--stop-time", "0.0003"],
        "--stop-time: stop_time must be a whole number of steps of 0.0002 s, got 0.0003",
    ),
    "stop_time_1e12": (["--stop-time", "1e12"], "--stop-time: stop_time must leave a recording that fits on the disk"),
    "unknown_structure": (
        ["--structure", "keil"],
        "--structure: structure 'keil' is neither a file nor a shipped "
        f"structure; did you mean 'kiel'? (valid: {', '.join(structure_files())})",
    ),
    "structure_is_folder": (["--structure", "."], "--structure: structure '.' is neither a file nor"),
    "structure_of_other_size": (
        ["--structure", "single_beam"],
        "input[1].targets[1].value must have 1 values, one for each point of interest",
    ),
    "unknown_basis": (["--basis", "segments"], "'segments' is not one of 'clamped_free', 'segment'"),
    "unknown_coupling": (["--coupling", "seidel"], "'seidel' is not one of 'jacobi', 'gauss-seidel'"),
    "unknown_option": (["--stop", "1"], "--stop"),
    "real_time_run_of_python_units": (["--backend", "python", "--real-time"], "--real-time needs native units"),
}


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=pytest.mark.native if case == "density_zero" else ()) for case in OPTIONS]
)
def test_option_with(case: str, refused: Refused, write_scenario: Write) -> None:
    options, complaint = OPTIONS[case]
    path = write_scenario("s", LOOP)
    assert complaint in refused(path, *options)


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("trackin", "scenario 'trackin' is neither a file nor a shipped scenario; did you mean 'tracking'? (valid: "),
        (".", "scenario '.' is neither a file nor a shipped scenario"),
        ("none.toml", "scenario 'none.toml' is neither a file nor a shipped scenario"),
        ("", "scenario '' is neither a file nor a shipped scenario"),
        ("a\0b", "is neither a file nor a shipped scenario"),
        ("x" * 5000, "is neither a file nor a shipped scenario"),
    ],
)
def test_no_such_scenario(refused: Refused, name: str, complaint: str) -> None:
    assert complaint in refused(name)


def test_second_of_two_scenarios_is_looked_at_before_the_first_runs(refused: Refused) -> None:
    assert "scenario 'trackin' is neither" in refused("tracking", "trackin")


def test_scenario_in_another_encoding(refused: Refused, tmp_path: Path) -> None:
    path = tmp_path / "latin.toml"
    path.write_bytes(LOOP.replace("Loop", "Schl\xe4ufe").encode("latin-1"))
    assert refused(path).startswith(f"{path}: is not UTF-8 text")


@pytest.mark.parametrize("place", ["file", "below_file", "impossible_folder"])
def test_no_folder_for_results(
    at_run_folder: Path, tmp_path: Path, write_scenario: Write, place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_scenario("s", LOOP)
    folder = {"file": path, "below_file": path / "out", "impossible_folder": Path("/proc/none")}[place]
    assert main(["run", str(path), "--out", str(folder)]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert len(shown.err.splitlines()) == 1
    assert str(folder) in shown.err


# FMU files


def fmu(path: Path, description: str) -> Path:
    """An archive with nothing but a description."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description)
    return path


HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription fmiVersion="{}" modelName="m" {}>{}'
    "<ModelVariables/><ModelStructure/></fmiModelDescription>"
)
ARCHIVES = {
    "fmi_3": (
        HEAD.format("3.0", 'instantiationToken="x"', '<CoSimulation modelIdentifier="m"/>'),
        "must be an FMI 2.0 co-simulation unit",
    ),
    "model_exchange_alone": (
        HEAD.format("2.0", 'guid="x"', '<ModelExchange modelIdentifier="m"/>'),
        "must be an FMI 2.0 co-simulation unit",
    ),
    "no_xml": ("no description", "must be an FMU"),
    "cut_off": (HEAD.format("2.0", 'guid="x"', "")[:100], "must be an FMU"),
    "no_binary": (
        HEAD.format("2.0", 'guid="x"', '<CoSimulation modelIdentifier="m"/>').replace(
            "<ModelVariables/>",
            '<ModelVariables><ScalarVariable name="u" valueReference="0" causality="input">'
            '<Real start="0"/></ScalarVariable></ModelVariables>',
        ),
        "instance.other cannot be loaded from",
    ),
}


@pytest.mark.parametrize("case", ARCHIVES)
def test_unit_file_with(case: str, refused: Refused, tmp_path: Path, write_scenario: Write) -> None:
    description, complaint = ARCHIVES[case]
    fmu(tmp_path / "other.fmu", description)
    path = write_scenario(
        "s", 'title = "x"\nstructure = "single_beam"\nstop_time = 0.01\n[instance.other]\nfmu = "other.fmu"\n'
    )
    line = refused(path)
    assert line.startswith(f"{path}: instance.other")
    assert complaint in line


def test_archive_without_a_description(refused: Refused, tmp_path: Path, write_scenario: Write) -> None:
    with zipfile.ZipFile(tmp_path / "other.fmu", "w") as archive:
        archive.writestr("readme.txt", "nothing")
    path = write_scenario("s", swapped('unit = "BeamPlant"', 'fmu = "other.fmu"'))
    assert "instance.plant.fmu must be an FMU" in refused(path)


def test_damaged_archive(refused: Refused, tmp_path: Path, write_scenario: Write, workshop: Workshop) -> None:
    content = workshop.fmu("BeamPlant").read_bytes()
    (tmp_path / "other.fmu").write_bytes(content[: len(content) // 2])
    path = write_scenario("s", swapped('unit = "BeamPlant"', 'fmu = "other.fmu"'))
    assert "instance.plant.fmu must be an FMU" in refused(path)


def test_units_of_two_designs(refused: Refused, write_scenario: Write, workshop: Workshop) -> None:
    """A controller designed on another basis has other coordinates; it would run, and wrongly."""
    file = workshop.fmu("TrackingController", "kiel", "segment")
    path = write_scenario("s", swapped('unit = "TrackingController"', f'fmu = "{file}"'))
    line = refused(path)
    assert line.startswith(f"{path}: instance units must be of one design (design_id): feedforward has ")
    assert line.endswith("; build them together")


def test_units_of_two_structures(refused: Refused, write_scenario: Write, workshop: Workshop) -> None:
    file = workshop.fmu("BeamPlant", "single_beam")
    assert "must be of one design" in refused(write_scenario("s", swapped('unit = "BeamPlant"', f'fmu = "{file}"')))


# Units that fail


@pytest.fixture(scope="module")
def lag_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The test unit, which fails when u[3] is large."""
    unit = lag.lag_unit(tmp_path_factory.mktemp("lag") / "lag.fmu")
    return build_python_units([unit])[0]


@pytest.mark.parametrize(
    ("value", "reason"),
    [(2e6, "u[3] must be <= 1e6, got 2000000.0"), (-2e6, "ZeroDivisionError: kernel fault ? (line ")],
)
def test_unit_that_fails_in_mid_run(
    at_run_folder: Path,
    write_scenario: Write,
    lag_file: Path,
    tmp_path: Path,
    value: float,
    reason: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Message, time and instance; rows up to then are kept and marked incomplete; no figures of half a run."""
    path = write_scenario(
        "failing",
        f'''title = "x"
structure = "single_beam"
stop_time = 1.0
step = 1e-3
[instance.first]
fmu = "{lag_file}"
[instance.second]
fmu = "{lag_file}"
[[input]]
to = "first.u"
constant = [1.0, 0.0, 0.0]
[[input]]
to = "second.u[3]"
step = {{ time = 0.7, value = {value} }}
[[check]]
name = "c"
measure = "largest"
of = "first.y"
max = 1e9
[[figure]]
file = "f"
rows = [["first.y"]]
''',
    )
    out = tmp_path / "out"
    assert main(["run", str(path), "--out", str(out)]) == 2
    *notes, line = capsys.readouterr().err.splitlines()
    assert notes == ["first: scale 2.0", "second: scale 2.0"]  # what the unit says of itself
    assert line.startswith("flexbeams: second failed at 0.7 s in fmi2DoStep: ")
    assert reason in line
    assert line.endswith(f"; what was recorded up to then is in {out}")
    assert sorted(p.name for p in out.iterdir()) == ["results.csv", "summary.json"]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["complete"] is False
    assert summary["error"].startswith("second failed at 0.7 s")
    assert summary["checks"] == []
    assert summary["timing"]["steps"] == 700
    rows = (out / "results.csv").read_text().splitlines()[1:]
    assert len(rows) == 701
    assert float(rows[-1].split(",")[0]) == pytest.approx(0.7)
    assert "nan" not in rows[-1]


def test_start_value_that_a_unit_refuses(refused: Refused, write_scenario: Write, workshop: Workshop) -> None:
    path = write_scenario(
        "s",
        swapped(
            'unit = "BeamPlant"',
            f'fmu = "{workshop.fmu("BeamPlant")}"\nscale."patch[].youngs_modulus" = [1.0, 1.0, 0.0, 1.0]',
        ),
    )
    line = refused(path, "--backend", "python")
    rule = "instance.plant.scale.patch[].youngs_modulus must be from 1000000.0 to 100000000000000.0, got 0.0"
    assert line == f"{path}: {rule}"
