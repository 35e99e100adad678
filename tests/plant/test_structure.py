"""The structure file: what it holds, and one line for each way in which it can be wrong."""

import re
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from flexbeams.plant.errors import InputError
from flexbeams.plant.structure import STRUCTURES_FOLDER, Structure, find_structure, read_structure
from tests.oracles.boundary_value import layer_moment
from tests.oracles.examples import beam, five_beams, gauge, patch, point, single_beam, three_beams

GOOD = """
[[beam]]
length = 1
width = 0.045
thickness = 8e-4
density = 1500
youngs_modulus = 40e9
tip_mass = 0
viscous_damping = 0
structural_damping = 0.004

[[beam]]
length = 0.4
width = 0.05
thickness = 8e-4
density = 1500.0
youngs_modulus = 40e9
tip_mass = 0.02
viscous_damping = 0.03
structural_damping = 0

[[patch]]
beam = 2
position = 0.02
length = 0.085
width = 0.025
thickness = 3e-4
density = 5440
youngs_modulus = 30e9
viscous_damping = 0.03
structural_damping = 0.004
piezo_ratio = 24
electrode_distance = 5e-4

[[spring]]
between = [1, 2]
stiffness = 7

[[point_of_interest]]
beam = 1
position = 0.9

[[strain_gauge]]
beam = 2
position = 0.06
length = 0.006
"""
MORE_PATCH = GOOD[GOOD.index("[[patch]]") : GOOD.index("[[spring]]")]
BEAM_KEYS = (
    "length",
    "width",
    "thickness",
    "density",
    "youngs_modulus",
    "tip_mass",
    "viscous_damping",
    "structural_damping",
)
PATCH_KEYS = (
    "position",
    "length",
    "width",
    "thickness",
    "density",
    "youngs_modulus",
    "viscous_damping",
    "structural_damping",
    "piezo_ratio",
    "electrode_distance",
)
MAY_BE_ZERO = {"tip_mass", "viscous_damping", "structural_damping", "beam position"}


def write(folder: Path, text: str | bytes) -> Path:
    path = folder / "structure.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refusal(path: Path) -> str:
    """The message of the refusal, without the path it starts with."""
    with pytest.raises(InputError) as caught:
        read_structure(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


def changed(section: str, key: str, value: str | None) -> str:
    """GOOD with a key of the last table of that name set to the TOML `value`, or without the key."""
    before, table = GOOD.rsplit(f"[[{section}]]\n", 1)
    line = "" if value is None else f"{key} = {value}\n"
    table, count = re.subn(rf"^{key} = .*\n", line, table, count=1, flags=re.MULTILINE)
    assert count == 1
    return f"{before}[[{section}]]\n{table}"


def test_a_good_file(tmp_path: Path) -> None:
    structure = read_structure(write(tmp_path, GOOD))
    assert [
        len(part)
        for part in (
            structure.beam,
            structure.patch,
            structure.spring,
            structure.point_of_interest,
            structure.strain_gauge,
        )
    ] == [2, 1, 1, 1, 1]
    assert structure.beam[1].width == 0.05
    assert structure.patch[0].beam == 2
    assert structure.spring[0].between == (1, 2)


def test_round_numbers_may_be_integers(tmp_path: Path) -> None:
    structure = read_structure(write(tmp_path, GOOD))
    assert structure.beam[0].length == 1
    parameters = structure.parameters()
    assert all(type(value) is float for value in parameters.values())
    assert (parameters["beam[1].density"], parameters["beam[1].tip_mass"], parameters["spring[1].stiffness"]) == (
        1500.0,
        0.0,
        7.0,
    )


@pytest.mark.parametrize(
    ("section", "keys"),
    [
        ("beam", BEAM_KEYS),
        ("patch", PATCH_KEYS),
        ("spring", ("stiffness",)),
        ("point_of_interest", ("position",)),
        ("strain_gauge", ("position", "length")),
    ],
)
def test_every_number_is_checked(tmp_path: Path, section: str, keys: tuple[str, ...]) -> None:
    number = 2 if section == "beam" else 1
    for key in keys:
        place = f"{section}[{number}].{key}"
        zero_allowed = key in MAY_BE_ZERO or (section, key) in {
            ("patch", "position"),
            ("strain_gauge", "length"),
            ("spring", "stiffness"),
        }
        rule = "must be >= 0" if zero_allowed else "must be finite and > 0"
        cases = [
            ("nan", "must be finite, got nan"),
            ("inf", "must be finite, got inf"),
            ("-inf", "must be finite, got -inf"),
            ("-0.3", f"{rule}, got -0.3"),
            ("true", "must be a number, got True"),
            ('"0.4"', "must be a number, got '0.4'"),
            ("[1.0]", "must be a number, got [1.0]"),
            ("{a = 1}", "must be a number, got 'dict'"),
            ("2020-01-01", "must be a number, got 'date'"),
            ("1e400", "must be finite, got inf"),
        ]
        if not zero_allowed:
            cases += [("0", f"{rule}, got 0"), ("0.0", f"{rule}, got 0.0")]
        for value, message in cases:
            assert refusal(write(tmp_path, changed(section, key, value))) == f"{place} {message}"
        assert refusal(write(tmp_path, changed(section, key, None))) == f"{place} is missing"


@pytest.mark.parametrize(
    ("section", "key"), [("patch", "beam"), ("point_of_interest", "beam"), ("strain_gauge", "beam")]
)
def test_beams_are_counted_from_one(tmp_path: Path, section: str, key: str) -> None:
    for value, message in (
        ("0", "must be >= 1, got 0"),
        ("-1", "must be >= 1, got -1"),
        ("1.0", "must be an integer, got 1.0"),
        ("true", "must be an integer, got True"),
        ('"1"', "must be an integer, got '1'"),
        ("3", "must be a beam from 1 to 2, got 3"),
        (None, "is missing"),
    ):
        assert refusal(write(tmp_path, changed(section, key, value))) == f"{section}[1].{key} {message}"


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("[1, 1]", "spring[1].between must be two adjacent beams from 1 to 2, got [1, 1]"),
        ("[1, 3]", "spring[1].between must be two adjacent beams from 1 to 2, got [1, 3]"),
        ("[2, 3]", "spring[1].between must be two adjacent beams from 1 to 2, got [2, 3]"),
        ("[0, 1]", "spring[1].between[1] must be >= 1, got 0"),
        ("[1, 2.0]", "spring[1].between[2] must be an integer, got 2.0"),
        ("[1]", "spring[1].between[2] is missing"),
        ("[1, 2, 3]", "spring[1].between must have at most 2 entries, got [1, 2, 3]"),
        ("12", "spring[1].between must be a list, got 12"),
    ],
)
def test_springs_join_neighbours(tmp_path: Path, value: str, message: str) -> None:
    assert refusal(write(tmp_path, changed("spring", "between", value))) == message


def test_a_spring_may_name_its_beams_in_either_order(tmp_path: Path) -> None:
    structure = read_structure(write(tmp_path, changed("spring", "between", "[2, 1]")))
    assert structure.spring[0].between == (2, 1)


def test_only_one_spring_between_two_beams(tmp_path: Path) -> None:
    text = GOOD + "[[spring]]\nbetween = [2, 1]\nstiffness = 1.0\n"
    assert refusal(write(tmp_path, text)) == "spring[2].between must not repeat an earlier spring, got [2, 1]"


@pytest.mark.parametrize(
    ("section", "key", "value", "message"),
    [
        (
            "patch",
            "position",
            "0.316",
            "patch[1].position plus length must not pass the end of beam 2 (0.4 m), got 0.401",
        ),
        ("patch", "length", "0.39", "patch[1].position plus length must not pass the end of beam 2 (0.4 m), got 0.41"),
        ("patch", "width", "0.051", "patch[1].width must not exceed the width of beam 2 (0.05 m), got 0.051"),
        (
            "point_of_interest",
            "position",
            "1.001",
            "point_of_interest[1].position must lie on beam 1 (0 ... 1.0 m), got 1.001",
        ),
        (
            "strain_gauge",
            "position",
            "0.398",
            "strain_gauge[1].position with its length 0.006 m must lie on beam 2 (0 ... 0.4 m), got 0.398",
        ),
        (
            "strain_gauge",
            "position",
            "0.002",
            "strain_gauge[1].position with its length 0.006 m must lie on beam 2 (0 ... 0.4 m), got 0.002",
        ),
        (
            "strain_gauge",
            "length",
            "0.7",
            "strain_gauge[1].position with its length 0.7 m must lie on beam 2 (0 ... 0.4 m), got 0.06",
        ),
    ],
)
def test_parts_lie_on_their_beam(tmp_path: Path, section: str, key: str, value: str, message: str) -> None:
    assert refusal(write(tmp_path, changed(section, key, value))) == message


@pytest.mark.parametrize(("position", "first", "second"), [("0.104", 1, 2), ("0.0", 2, 1), ("0.02", 1, 2)])
def test_patches_do_not_overlap(tmp_path: Path, position: str, first: int, second: int) -> None:
    text = GOOD + MORE_PATCH.replace("position = 0.02", f"position = {position}")
    start, end = (0.02, 0.085) if first == 2 else (float(position), 0.105)
    assert refusal(write(tmp_path, text)) == (
        f"patch[{second}].position must not overlap patch[{first}], which ends at {end} m, got {start}"
    )


def test_patches_of_different_beams_may_lie_side_by_side(tmp_path: Path) -> None:
    text = GOOD + MORE_PATCH.replace("beam = 2", "beam = 1")
    assert len(read_structure(write(tmp_path, text)).patch) == 2


@pytest.mark.parametrize(("start", "length"), [(0.02, 0.085), (0.1, 0.2), (0.3, 0.1)])
def test_parts_may_touch(tmp_path: Path, start: float, length: float) -> None:
    """0.02 + 0.085 and 0.1 + 0.2 are more than 0.105 and 0.3 in doubles."""
    first = MORE_PATCH.replace("position = 0.02", f"position = {start}").replace("length = 0.085", f"length = {length}")
    after = round(start + length, 12)
    rest = f"position = {after}" if after < 0.4 else "position = 0.0"
    text = GOOD.replace(MORE_PATCH, first + MORE_PATCH.replace("position = 0.02", rest))
    assert len(read_structure(write(tmp_path, text)).patch) == 2


def test_gauges_and_points_may_reach_the_ends() -> None:
    first = beam(1, length=0.41)
    structure = Structure(
        beam=[first],
        patch=[patch(1, 1, 0.0)],
        point_of_interest=[point(1, 0.41)],
        strain_gauge=[gauge(1, 0.005, 0.01), gauge(1, 0.405, 0.01), gauge(1, 0.41, 0.0)],
    )
    assert len(structure.strain_gauge) == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "beam is missing"),
        ("# only a comment\n", "beam is missing"),
        (GOOD[: GOOD.index("[[strain_gauge]]")], "strain_gauge is missing"),
        (GOOD.replace(MORE_PATCH, ""), "patch is missing"),
        ("beam = []\n" + GOOD[GOOD.index("[[patch]]") :], "beam must have at least 1 entries, got []"),
        ("beam = 3\n" + GOOD[GOOD.index("[[patch]]") :], "beam must be a list, got 3"),
        ("[beam]\n" + GOOD[GOOD.index("[[patch]]") :], "beam must be a list: [[beam]] begins each of its tables"),
        ("beam = [3]\n" + GOOD[GOOD.index("[[patch]]") :], "beam[1] must be a table, got 3"),
        (
            "patches = 1\n" + GOOD,
            "patches is not a known key; did you mean 'patch'? "
            "(valid: beam, patch, spring, point_of_interest, strain_gauge, actuator)",
        ),
        (
            "zzz = 1\n" + GOOD,
            "zzz is not a known key (valid: beam, patch, spring, point_of_interest, strain_gauge, actuator)",
        ),
        (
            GOOD.replace("tip_mass", "tip_mas", 1),
            f"beam[1].tip_mas is not a known key; did you mean 'tip_mass'? (valid: {', '.join(BEAM_KEYS)})",
        ),
        (
            GOOD.replace("piezo_ratio", "peizo_ratio"),
            "patch[1].peizo_ratio is not a known key; did you mean "
            f"'piezo_ratio'? (valid: beam, {', '.join(PATCH_KEYS)})",
        ),
        (
            GOOD.replace("stiffness", "stifness"),
            "spring[1].stifness is not a known key; did you mean 'stiffness'? (valid: between, stiffness)",
        ),
    ],
)
def test_shape_of_the_file(tmp_path: Path, text: str, message: str) -> None:
    assert refusal(write(tmp_path, text)) == message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"beam = [", r"is not valid TOML: .*"),
        (GOOD.encode() + b"[[beam", r"is not valid TOML: .*at end of document.*"),
        (GOOD.encode().replace(b"width", b"length", 1), r"is not valid TOML: .*line 4.*"),
        (b"length = 1" + b"0" * 5000, r"is not valid TOML: .*"),
        (b"beam = " + b"[" * 20000, r"is not valid TOML: .*"),
        (b"\0", r"is not valid TOML: .*"),
        (GOOD.encode() + b"# caf\xe9\n", r"is not UTF-8 text: .*"),
    ],
)
def test_not_toml(tmp_path: Path, text: bytes, message: str) -> None:
    assert re.fullmatch(message, refusal(write(tmp_path, text)))


def test_a_key_of_two_lines_is_refused_in_one(tmp_path: Path) -> None:
    assert "is not a known key" in refusal(write(tmp_path, GOOD.replace("width", r'"wid\nth"', 1)))


def test_missing_file_and_folder(tmp_path: Path) -> None:
    assert refusal(tmp_path / "none.toml") == "cannot be read: No such file or directory"
    assert refusal(tmp_path).startswith("cannot be read: ")


def test_structures_made_by_hand_are_checked_too() -> None:
    with pytest.raises(ValidationError, match=re.escape("patch[1].beam must be a beam from 1 to 1, got 2")):
        Structure(
            beam=[beam()], patch=[patch(1, 2, 0.02)], point_of_interest=[point(1, 0.1)], strain_gauge=[gauge(1, 0.1)]
        )
    with pytest.raises(ValidationError, match="greater than 0"):
        beam(1, length=0.0)


@pytest.mark.parametrize(("structure", "count"), [(single_beam(), 10), (three_beams(), 37), (five_beams(), 58)])
def test_parameters_are_counted_and_named(structure: Structure, count: int) -> None:
    parameters = structure.parameters()
    assert len(parameters) == count
    assert parameters["beam[1].youngs_modulus"] == structure.beam[0].youngs_modulus
    last = len(structure.patch)
    assert parameters[f"patch[{last}].piezo_ratio"] == structure.patch[-1].piezo_ratio
    assert structure.with_parameters(parameters) == structure


def test_with_parameters_changes_a_copy() -> None:
    structure = three_beams()
    changes = {"beam[2].tip_mass": 0.0, "patch[4].density": 5000.0, "spring[2].stiffness": 1.5}
    copy = structure.with_parameters(changes)
    differing = {k for k, v in copy.parameters().items() if v != structure.parameters()[k]}
    assert differing == set(changes)
    assert (copy.beam[1].tip_mass, copy.patch[3].density, copy.spring[1].stiffness) == (0.0, 5000.0, 1.5)
    assert structure == three_beams()


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("beam[2].densty", 1.0, "beam[2].densty is not a parameter; did you mean 'beam[2].density'?"),
        ("beam[4].density", 1.0, "beam[4].density is not a parameter"),
        ("beam[1].length", 1.0, "beam[1].length is not a parameter"),
        (
            "spring[1].stiffness",
            -1.0,
            "spring[1].stiffness must be finite and >= 0, got -1.0",
        ),
        ("beam[1].tip_mass", -1.0, "beam[1].tip_mass must be finite and >= 0, got -1.0"),
        ("patch[1].density", np.nan, "patch[1].density must be finite and > 0, got nan"),
        ("patch[1].density", np.inf, "patch[1].density must be finite and > 0, got inf"),
    ],
)
def test_with_parameters_refuses(key: str, value: float, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        three_beams().with_parameters({key: value})


def test_section_of_a_beam() -> None:
    """Area and second moment of a rectangle, by quadrature over the thickness."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    part = beam(2)
    z = part.thickness / 2 * nodes
    assert part.area == pytest.approx(part.width * part.thickness / 2 * weights.sum(), rel=1e-14)
    assert part.second_moment == pytest.approx(part.width * part.thickness / 2 * weights @ z**2, rel=1e-14)


def test_second_moment_of_a_patch_is_the_integral_over_its_layer() -> None:
    """With the 1/3 that the printed formula lacks."""
    structure = five_beams()
    for part in structure.patch:
        carrier = structure.beam[part.beam - 1]
        assert part.second_moment(carrier) == pytest.approx(layer_moment(structure, part, 2), rel=1e-12)
        assert part.area == pytest.approx(layer_moment(structure, part, 0), rel=1e-14)


def test_moment_per_volt() -> None:
    """(9); equal to two layers, each pulled by half the ratio in the field U / e_s, about the middle of the beam."""
    structure = five_beams()
    for part in structure.patch:
        carrier = structure.beam[part.beam - 1]
        printed = (
            part.width
            * part.thickness
            * (carrier.thickness + part.thickness)
            * part.piezo_ratio
            / (2 * part.electrode_distance)
        )
        layers = 2 * layer_moment(structure, part, 1) * part.piezo_ratio / 2 / part.electrode_distance
        assert part.moment_per_volt(carrier) == pytest.approx(printed, rel=1e-14)
        assert part.moment_per_volt(carrier) == pytest.approx(layers, rel=1e-12)


def test_kiel_is_the_structure_of_the_paper() -> None:
    structure = read_structure(find_structure("kiel"))
    assert [p.beam for p in structure.patch] == [1, 2, 2, 3]
    assert [tuple(s.between) for s in structure.spring] == [(1, 2), (2, 3)]
    assert [p.beam for p in structure.point_of_interest] == [1, 2, 2, 3]
    assert len(structure.beam) == 3
    assert len(structure.strain_gauge) == 6
    assert len(structure.parameters()) == 37
    assert all(p.electrode_distance == 5e-4 for p in structure.patch)


def test_every_patch_pair_of_kiel_has_a_gauge_beside_it() -> None:
    """Free spans bend only by the spring forces: an actuator's error is seen beside the actuator only."""
    structure = read_structure(find_structure("kiel"))
    for part in structure.patch:
        assert any(
            g.beam == part.beam and part.position < g.position - g.length / 2 and g.position + g.length / 2 < part.end
            for g in structure.strain_gauge
        )
        assert part.width < structure.beam[part.beam - 1].width


@pytest.mark.parametrize("path", sorted(STRUCTURES_FOLDER.glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_structures_are_found_by_name(path: Path) -> None:
    assert find_structure(path.stem) == path
    assert read_structure(path).beam


def test_a_file_is_found_before_a_shipped_name(tmp_path: Path) -> None:
    path = write(tmp_path, GOOD)
    assert find_structure(str(path)) == path
    assert find_structure("structure.toml", relative_to=tmp_path) == path


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("kial", "structure 'kial' is neither a file nor a shipped structure; did you mean 'kiel'?"),
        ("", "structure '' is neither a file nor a shipped structure"),
        ("x" * 5000, "is neither a file nor a shipped structure"),
    ],
)
def test_unknown_structure(name: str, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        find_structure(name)
