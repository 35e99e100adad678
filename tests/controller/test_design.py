"""One design: file, hash, summary and the options that are refused."""

import json
import math
import re
from dataclasses import asdict, fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from flexbeams.controller.canonical import RELIABLE_GAP
from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.design_file import read_design, write_design
from flexbeams.controller.design_record import fingerprint, identify
from flexbeams.controller.options import DesignOptions, Weights
from flexbeams.plant.archive import npz_bytes, read_arrays
from flexbeams.plant.errors import DesignError, InputError
from flexbeams.plant.structure import find_structure, read_structure
from flexbeams.plant.validation import validate
from tests.oracles.examples import five_beams, single_beam, three_beams, uncoupled_beams

KIEL = read_structure(find_structure("kiel"))


@cache
def design(**options: object) -> Design:
    """A design of kiel.toml."""
    return compute_design(KIEL, DesignOptions(**options))  # type: ignore[arg-type]


@pytest.fixture
def written(tmp_path: Path) -> Path:
    """A file of the default design."""
    path = tmp_path / "design.npz"
    write_design(design(), path)
    return path


def test_shapes() -> None:
    """m = 30 states, n_u = n_pi = 4, n_pm = 6; the five-beam example has n_u = 6, n_pi = 2, n_pm = 4."""
    for made, m, n_u, n_pi, n_pm, r in (
        (design(), 30, 4, 4, 6, 3),
        (compute_design(five_beams(), DesignOptions(reduced_modes=4)), 40, 6, 2, 4, 5),
    ):
        shapes = {name: array.shape for name, array in made.arrays.items()}
        curves = shapes.pop("shape_times") + shapes["shape_values"][1:]
        assert shapes.pop("shape_values") == curves
        assert shapes == {
            "A": (m, m),
            "B": (m, n_u),
            "H_pi": (n_pi, m),
            "H_pm": (n_pm, m),
            "H_w": (21 * r, m),
            "D_pi": (n_pi, n_u),
            "D_pm": (n_pm, n_u),
            "D_w": (21 * r, n_u),
            "A_d": (m, m),
            "B_d": (m, n_u),
            "estimator_gain": (m, n_pm),
            "feedback_gain": (n_u, m),
            "static_inverse": (n_u, n_pi),
            "flat_ratios": (m,),
            "mode_series": (m, m),
            "mode_inputs": (m, n_u),
            "mode_states": (m, m),
            "unreachable": (n_pi, n_pi),
            "transition_table": (257,),
            "transition_constants": (2,),
        }
        assert all(a.dtype == np.float64 and np.all(np.isfinite(a)) for a in made.arrays.values())


def test_sampled_model_is_exact() -> None:
    """A_d = exp(A t_d), B_d = A^-1 (A_d - I) B, through A's eigenvalues."""
    arrays = design().arrays
    values, vectors = np.linalg.eig(arrays["A"])
    A_d = (vectors * np.exp(values * 2e-4)) @ np.linalg.inv(vectors)
    np.testing.assert_allclose(arrays["A_d"], A_d.real, rtol=0, atol=1e-12)
    B_d = np.linalg.solve(arrays["A"], (A_d.real - np.eye(30)) @ arrays["B"])
    np.testing.assert_allclose(arrays["B_d"], B_d, rtol=0, atol=1e-10 * np.abs(B_d).max())


@pytest.mark.parametrize("static_gain", ["full", "reduced"])
@pytest.mark.parametrize("static_correction", [True, False])
def test_a_target_becomes_the_voltage_that_holds_it(static_gain: str, static_correction: bool) -> None:
    """With the full gain the plant rests on target; with the reduced one the model does, corrected or not."""
    made = design(static_gain=static_gain, static_correction=static_correction)
    target = np.array([-8e-3, 1e-3, 4e-3, -6e-3])
    voltage = made.arrays["static_inverse"] @ target
    a = made.arrays
    of_model = a["H_pi"] @ -np.linalg.solve(a["A"], a["B"] @ voltage) + a["D_pi"] @ voltage
    of_plant = np.array(made.summary["static_gain_pi"]) @ voltage
    np.testing.assert_allclose(of_plant if static_gain == "full" else of_model, target, rtol=0, atol=1e-12)
    if static_correction:
        np.testing.assert_allclose(of_plant, of_model, rtol=0, atol=1e-12)
    else:
        assert 1e-4 < np.max(np.abs(of_plant - of_model)) < 2e-3


def test_summary_agrees_with_the_arrays() -> None:
    summary, arrays = design().summary, design().arrays
    json.dumps(summary, allow_nan=False)
    assert (summary["full_order"], summary["reduced_order"], summary["parameters"]) == (60, 30, 37)
    assert summary["basis"] == "clamped_free"
    assert summary["hankel_share"] == pytest.approx(
        sum(sum(summary[f"hankel_{k}"][:15]) for k in ("position", "velocity"))
        / sum(sum(summary[f"hankel_{k}"]) for k in ("position", "velocity")),
        rel=1e-12,
    )
    assert summary["frequencies"] == sorted(summary["frequencies"])
    assert len(summary["damping_ratios"]) == 30
    assert all(0 < ratio < 1 for ratio in summary["damping_ratios"])
    reduced = np.array(summary["reduced_eigenvalues"])
    np.testing.assert_allclose(
        np.sort_complex(reduced[:, 0] + 1j * reduced[:, 1]), np.sort_complex(np.linalg.eigvals(arrays["A"])), rtol=1e-12
    )
    for name, matrix in (
        ("estimator", arrays["A_d"] - arrays["estimator_gain"] @ arrays["H_pm"]),
        ("feedback", arrays["A_d"] - arrays["B_d"] @ arrays["feedback_gain"]),
    ):
        listed = np.array(summary[f"{name}_eigenvalues"])
        assert np.all(listed[:, 0] < 0)
        sampled = np.exp((listed[:, 0] + 1j * listed[:, 1]) * 2e-4)
        np.testing.assert_allclose(np.sort_complex(sampled), np.sort_complex(np.linalg.eigvals(matrix)), rtol=1e-9)
    np.testing.assert_allclose(
        np.array(summary["static_gain_reduced_pi"]) + arrays["D_pi"], summary["static_gain_pi"], rtol=1e-10
    )


def test_a_structure_with_overdamped_modes_has_a_summary() -> None:
    made = compute_design(single_beam(viscous_damping=30.0), DesignOptions(reduced_modes=3))
    json.dumps(made.summary, allow_nan=False)
    assert made.summary["real_eigenvalues"]


def test_file_holds_the_design_bit_by_bit(written: Path) -> None:
    found = read_design(written)
    assert found.design_id == design().design_id
    assert found.structure == KIEL
    assert found.options == design().options
    assert found.summary == design().summary
    assert list(found.arrays) == sorted(design().arrays)
    for name, array in design().arrays.items():
        assert found.arrays[name].dtype == array.dtype
        assert found.arrays[name].tobytes() == array.tobytes()
    again = written.with_name("again.npz")
    write_design(found, again)
    assert again.read_bytes() == written.read_bytes()


def test_equal_inputs_give_equal_bytes_on_one_machine(written: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    again = written.with_name("again.npz")
    write_design(compute_design(read_structure(find_structure("kiel")), DesignOptions()), again)
    assert again.read_bytes() == written.read_bytes()


def test_id_depends_on_every_option() -> None:
    others = {
        "basis": "segment",
        "order": 4,
        "reduced_modes": 2,
        "output_weight": "energy",
        "static_correction": False,
        "static_gain": "reduced",
        "static_maps": "segment",
        "observer": "offset_free",
        "uncertainty": {"spring[].stiffness": 0.2},
        "targets": "nearest",
        "planner": "multi_input",
        "sample_time": 1e-4,
        "transition_time": 0.8,
        "gevrey_order": 1.8,
        "voltage_limit": 900.0,
        "voltage_min": [-900.0, -500.0, -500.0, -500.0],
        "voltage_max": [900.0, 500.0, 500.0, 0.0],
        "integral_gain": 2e-5,
        "verify": "design",
        "weights": Weights(lqr_input=0.02),
    }
    assert set(others) == {f.name for f in fields(DesignOptions)}
    made = [DesignOptions(), *(DesignOptions(**{name: value}) for name, value in others.items())]  # type: ignore[arg-type]
    made += [DesignOptions(weights=Weights(**{f.name: getattr(Weights(), f.name) * 1.01})) for f in fields(Weights)]
    ids = [identify(KIEL, options, {}) for options in made]
    assert len(set(ids)) == len(ids)
    assert all(re.fullmatch(r"[0-9a-f]{32}", i) for i in ids)


def test_id_is_that_of_the_inputs_where_coordinates_are_reliable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not of the arrays' last bits; but of the method's version."""
    assert design().design_id == identify(KIEL, DesignOptions(), {})
    assert design().summary["truncation_gap"] > RELIABLE_GAP
    monkeypatch.setattr("flexbeams.controller.design_record.METHOD", 10**6)
    assert identify(KIEL, DesignOptions(), {}) != design().design_id


def test_unreliable_coordinates_carry_a_fingerprint(monkeypatch: pytest.MonkeyPatch) -> None:
    """A truncation between nearly equal singular values, here of uncoupled equal beams."""
    structure = uncoupled_beams()
    made = compute_design(structure, DesignOptions(reduced_modes=1, order=6))
    assert made.summary["truncation_gap"] > RELIABLE_GAP
    monkeypatch.setattr("flexbeams.controller.canonical.RELIABLE_GAP", 1.0)
    marked = compute_design(structure, DesignOptions(reduced_modes=1, order=6))
    assert marked.design_id == f"{made.design_id}-{fingerprint(made.arrays)[:8]}"


def test_id_depends_on_every_kind_of_value_of_the_structure() -> None:
    """To the last bits of parameters, and on geometry."""
    last = {name.split("[")[0] + name.split("]")[1]: name for name in KIEL.parameters()}
    others = [KIEL.with_parameters({name: KIEL.parameters()[name] * (1 + 1e-12)}) for name in last.values()]
    others.append(replace(KIEL, beam=[replace(KIEL.beam[0], width=0.046), *KIEL.beam[1:]]))
    others.append(replace(KIEL, strain_gauge=[*KIEL.strain_gauge[1:], KIEL.strain_gauge[0]]))
    assert len(others) == 13
    assert len({identify(s, DesignOptions(), {}) for s in [KIEL, *others]}) == 14


def test_defaults_are_written_out() -> None:
    """order = 10 and output_weight = identity are what `None` stands for: same arrays, though another text."""
    explicit = design(order=10, output_weight="identity")
    for name, array in design().arrays.items():
        np.testing.assert_array_equal(explicit.arrays[name], array)
    explicit = design(basis="segment", output_weight="energy", order=9)
    np.testing.assert_array_equal(design(basis="segment").arrays["A"], explicit.arrays["A"])


@pytest.mark.parametrize("name", ["A_d", "estimator_gain", "shape_values", "transition_constants"])
def test_an_altered_array_is_noticed(written: Path, name: str) -> None:
    arrays = read_arrays(written)
    arrays[name].flat[-1] = np.nextafter(arrays[name].flat[-1], 2.0)
    written.write_bytes(npz_bytes(arrays))
    with pytest.raises(InputError, match=r"design.npz: .*altered"):
        read_design(written)


def test_an_altered_option_is_noticed(written: Path) -> None:
    arrays = read_arrays(written)
    meta = json.loads(str(arrays["meta"]))
    meta["options"]["voltage_limit"] = 1200.0
    arrays["meta"] = np.array(json.dumps(meta))
    written.write_bytes(npz_bytes(arrays))
    with pytest.raises(InputError, match=r"design.npz: .*altered"):
        read_design(written)


def spoiled(written: Path, **changes: object) -> Path:
    """The file with entries of its meta text replaced or, where the value is None, removed."""
    arrays = read_arrays(written)
    meta = {**json.loads(str(arrays["meta"])), **changes}
    arrays["meta"] = np.array(json.dumps({k: v for k, v in meta.items() if v is not None}))
    written.write_bytes(npz_bytes(arrays))
    return written


def test_another_format_is_refused(written: Path) -> None:
    with pytest.raises(InputError, match=r"design.npz: format must be \d+; make the design again, got 99"):
        read_design(spoiled(written, format=99))


def test_a_file_of_another_method_is_refused(written: Path) -> None:
    with pytest.raises(InputError, match=r"design.npz: method must be \d+; make the design again, got 1"):
        read_design(spoiled(written, method=1))


@pytest.mark.parametrize("missing", ["format", "method", "structure", "options", "summary", "design_id", "checksum"])
def test_a_file_without_a_part_is_refused(written: Path, missing: str) -> None:
    with pytest.raises(InputError, match=r"design\.npz: is not a flexbeams design file"):
        read_design(spoiled(written, **{missing: None}))


@pytest.mark.parametrize("meta", [None, "not JSON", "[1, 2]", "3", "null"])
def test_other_archives_are_refused(tmp_path: Path, meta: str | None) -> None:
    path = tmp_path / "other.npz"
    arrays = {"a": np.zeros(3)} if meta is None else {"meta": np.array(meta)}
    path.write_bytes(npz_bytes(arrays))
    with pytest.raises(InputError, match=r"other\.npz: is not a flexbeams design file"):
        read_design(path)


@pytest.mark.parametrize("content", [b"", b"PK", b"hello", b"\x93NUMPY"])
def test_files_that_are_no_archives_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "junk.npz"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"junk\.npz: is not a readable NumPy archive"):
        read_design(path)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none.npz: .*No such file"):
        read_design(tmp_path / "none.npz")


def test_a_cut_file_is_refused(written: Path) -> None:
    written.write_bytes(written.read_bytes()[:5000])
    with pytest.raises(InputError, match="is not a readable NumPy archive"):
        read_design(written)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"basis": "fourier"}, r"basis must be 'clamped_free' or 'segment', got 'fourier'"),
        ({"reduced_modes": 0}, r"reduced_modes must be >= 1, got 0"),
        ({"reduced_modes": 2.5}, r"reduced_modes must be an integer, got 2.5"),
        ({"order": -1}, r"order must be >= 1, got -1"),
        ({"sample_time": 0.0}, r"sample_time must be finite and > 0, got 0.0"),
        ({"sample_time": math.nan}, r"sample_time must be finite.*, got nan"),
        ({"voltage_limit": math.inf}, r"voltage_limit must be finite, got inf"),
        ({"transition_time": "soon"}, r"transition_time must be a number, got 'soon'"),
        ({"gevrey_order": 1.0}, r"gevrey_order must be >= 1.2, got 1.0"),
        ({"gevrey_order": 2.0}, r"gevrey_order must be < 2, got 2.0"),
        ({"gevrey_order": math.nan}, r"gevrey_order must be .*, got nan"),
        ({"verify": "reduced"}, r"verify must be 'exact' or 'design', got 'reduced'"),
        ({"integral_gain": -1e-5}, r"integral_gain must be >= 0, got -1e-05"),
        ({"static_correction": 1}, r"static_correction must be true or false, got 1"),
        ({"weights": {"lqr_input": 0.0}}, r"weights.lqr_input must be finite and > 0, got 0.0"),
        ({"weights": {"lqr_inptu": 1.0}}, r"weights.lqr_inptu is not a known key; did you mean 'lqr_input'\?"),
        ({"static_gian": "full"}, r"static_gian is not a known key; did you mean 'static_gain'\?"),
    ],
)
def test_bad_options_are_refused_by_name(table: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=f"^run.toml: {message}"):
        validate(DesignOptions, table, "run.toml")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"reduced_modes": 11},
            r"reduced_modes must be 1 to 10, modes of each beam \(the model has 30 for 3 beams\), got 11$",
        ),
        ({"basis": "segment", "order": 2}, "order must be >= 3 for the basis segment, got 2"),
        ({"order": 2}, r"reduced_modes must be 1 to 2, modes of each beam .*, got 5$"),
    ],
)
def test_options_that_do_not_fit_the_structure_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(DesignError, match=message):
        compute_design(KIEL, DesignOptions(**options))  # type: ignore[arg-type]


def test_no_damping_is_refused() -> None:
    undamped = {name: 0.0 for name in KIEL.parameters() if name.endswith("damping")}
    with pytest.raises(DesignError, match=r"the mode at [\d.]+ rad/s is not damped"):
        compute_design(KIEL.with_parameters(undamped), DesignOptions())


def test_model_of_the_design_or_of_another_basis() -> None:
    made = design(order=6)
    assert (made.model().basis, made.model().order, made.model().size) == ("clamped_free", 6, 18)
    assert made.model(order=4).order == 4
    other = made.model("segment")
    assert (other.basis, other.order) == ("segment", 9)
    assert made.model("segment", 5).order == 5


def test_structures_of_one_three_and_five_beams() -> None:
    for structure in (single_beam(), three_beams(), five_beams()):
        made = compute_design(structure, DesignOptions())
        assert made.summary["beams"] == len(structure.beam)
        assert made.summary["hankel_share"] > 0.6
        assert made.arrays["A"].shape == (10 * len(structure.beam),) * 2
        assert validate(DesignOptions, asdict(made.options), "") == made.options
