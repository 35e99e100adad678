"""kiel.toml against the facts in the paper's text, and the script that made it."""

import re
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import OptimizeResult, differential_evolution

from flexbeams.controller.design import compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.plant import reconstruction
from flexbeams.plant.basis import Array
from flexbeams.plant.energy import discretise, energy_form
from flexbeams.plant.errors import DesignError
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.measures import overshoots, settling_time
from flexbeams.plant.reconstruction import (
    BOUNDS,
    FITTED,
    HEADER,
    ORIGIN,
    PIEZO_RATIO,
    misfit,
    parameters_of,
    piezo_ratios,
    reconstruct,
    step_response,
    template,
    write_structure,
)
from flexbeams.plant.statespace import static_gains
from flexbeams.plant.structure import find_structure, read_structure
from tests.oracles.examples import five_beams, single_beam, three_beams

# Section 4 of the paper
VOLTAGE = np.array([817.0, -770.0, -807.0, 781.0])
DEFLECTION = np.array([-8e-3, 1e-3, 4e-3, -6e-3])
TIPS = [0, 2, 3]

KIEL = find_structure("kiel")
STEP = 2e-3


@cache
def simulated() -> tuple[Array, Array]:
    """Time (k,) in s and y_pi (k, 4) in m after the voltage step at time 0, exact for any sample."""
    model = beam_model(read_structure(KIEL), "clamped_free", 10)
    system = model.assemble()
    form = energy_form(system.M, system.D, system.K, system.L)
    A_d, B_d = discretise(form.A, form.B, STEP)
    x, forced = np.zeros(len(A_d)), B_d @ VOLTAGE
    states = np.zeros((round(30 / STEP) + 1, len(A_d)))
    for k in range(1, len(states)):
        x = states[k] = A_d @ x + forced
    return np.linspace(0, STEP * (len(states) - 1), len(states)), states @ form.outputs(model.deflection).T


def test_static_relation() -> None:
    model = beam_model(read_structure(KIEL), "clamped_free", 10)
    gain, _ = static_gains(model, model.assemble())
    np.testing.assert_allclose(gain @ VOLTAGE, DEFLECTION, rtol=1e-9)


def test_number_of_parameters() -> None:
    structure = read_structure(KIEL)
    assert len(structure.parameters()) == 37
    assert [sum(p.beam == j for p in structure.patch) for j in (1, 2, 3)] == [1, 2, 1]
    assert [p.beam for p in structure.point_of_interest] == [1, 2, 2, 3]
    assert len(structure.strain_gauge) == 6


def test_overshoot_of_the_step_response() -> None:
    """Point 3, the tip of beam 2: 150 +- 5 % of its end value; all tips between 4 and 6 mm, within 3 %."""
    _, y = simulated()
    over = overshoots(y, DEFLECTION)
    assert over[2] / abs(DEFLECTION[2]) == pytest.approx(1.5, abs=0.05)
    assert np.all(over[TIPS] >= 4e-3 * 0.97)
    assert np.all(over[TIPS] <= 6e-3 * 1.03)


def test_settling_of_the_step_response() -> None:
    """17 to 19 s to 2 % of each tip's own end value."""
    time, y = simulated()
    assert 17 <= settling_time(time, y[:, TIPS], DEFLECTION[TIPS], 0.0) <= 19


def test_share_of_the_singular_values_that_the_paper_keeps() -> None:
    """80 to 84 % with N_r = 5; the paper's 82 %."""
    assert 0.80 <= compute_design(read_structure(KIEL), DesignOptions()).summary["hankel_share"] <= 0.84


def test_piezo_ratios_are_near_the_data_sheets() -> None:
    ratios = np.array([p.piezo_ratio for p in read_structure(KIEL).patch])
    assert pytest.approx(24.24) == PIEZO_RATIO
    assert np.all(ratios / PIEZO_RATIO < 1.5)
    assert np.all(ratios / PIEZO_RATIO > 1 / 1.5)


def test_every_value_has_its_origin() -> None:
    """One of four words behind each value; what `tomllib` reads is all in such lines."""
    text = KIEL.read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith(("[", "#"))]
    assert all(re.fullmatch(r"\w+ = .+ # (paper|datasheet|assumed|fitted)", line) for line in lines)
    tables = tomllib.loads(text)
    actuator = tables.pop("actuator")
    pairs = actuator.pop("pair")
    assert len(lines) == len(actuator) + sum(len(item) for items in (*tables.values(), pairs) for item in items)
    fitted = {line.split(" = ")[0] for line in lines if line.endswith("fitted")}
    assert fitted == {"youngs_modulus", "tip_mass", "viscous_damping", "structural_damping", "piezo_ratio", "stiffness"}


def test_the_file_is_what_the_script_writes(tmp_path: Path) -> None:
    write_structure(read_structure(KIEL), tmp_path / "kiel.toml", ORIGIN, HEADER)
    assert (tmp_path / "kiel.toml").read_bytes() == KIEL.read_bytes()


def test_the_file_belongs_to_the_template_and_is_its_own_fit() -> None:
    """Assumed and data sheet values are the template's; the fit's cost there is below what is accepted."""
    structure, model = read_structure(KIEL), beam_model(template(), "clamped_free", 10)
    parameters = structure.parameters()
    candidate = np.array([parameters.get(name, parameters.get(f"beam[1].{name}", 0.0)) for name in FITTED])
    assert np.all((candidate > BOUNDS[:, 0]) & (candidate < BOUNDS[:, 1]))
    ratios = {f"patch[{k}].piezo_ratio": parameters[f"patch[{k}].piezo_ratio"] for k in (1, 2, 3, 4)}
    np.testing.assert_allclose(piezo_ratios(model, parameters_of(candidate)), list(ratios.values()), rtol=1e-11)
    assert template().with_parameters(parameters_of(candidate) | ratios) == structure
    assert misfit(model)(candidate) < 25


@pytest.mark.parametrize("seed", range(4))
def test_piezo_ratios_solve_the_static_relation(seed: int) -> None:
    """For any other parameters."""
    model = beam_model(template(), "clamped_free", 6)
    candidate = np.random.default_rng(seed).uniform(*BOUNDS.T)
    parameters = parameters_of(candidate)
    parameters |= {f"patch[{k}].piezo_ratio": float(p) for k, p in enumerate(piezo_ratios(model, parameters), 1)}
    gain, _ = static_gains(model, model.assemble(parameters))
    np.testing.assert_allclose(gain @ VOLTAGE, DEFLECTION, rtol=1e-9)


def test_modal_step_response_of_the_fit() -> None:
    """By the slow modes only, against the exact simulation: 0.2 mm at first, 0.02 mm when the others have decayed."""
    structure = read_structure(KIEL)
    time, y = simulated()
    found = step_response(beam_model(template(), "clamped_free", 10), structure.parameters(), time[:2000])
    error = np.abs(found - y[:2000, TIPS])
    assert np.max(error) < 2e-4
    assert np.max(error[time[:2000] > 0.2]) < 2e-5


def test_negative_ratios_cost_more_than_any_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the static relation asks for patches of the wrong sign there is nothing to simulate."""
    monkeypatch.setattr(reconstruction, "piezo_ratios", lambda model, parameters: np.array([24.0, -3.0, 24.0, -1.0]))
    assert misfit(beam_model(template(), "clamped_free", 6))(BOUNDS.mean(axis=1)) == 1e6 + 4


@pytest.mark.parametrize("build", [single_beam, three_beams, five_beams])
def test_written_structures_are_read_back(build, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    structure = build()
    write_structure(structure, tmp_path / "structure.toml", {}, "A line.\nAnother.")
    assert read_structure(tmp_path / "structure.toml") == structure
    text = (tmp_path / "structure.toml").read_text(encoding="utf-8")
    assert text.startswith("# A line.\n# Another.\n")


def end_with(misfit_left: float, monkeypatch: pytest.MonkeyPatch) -> list[dict[str, object]]:
    """Replaces the evolution by one that ends at once in the middle of the bounds; returns what it is called with."""
    calls: list[dict[str, object]] = []

    def evolution(cost: object, bounds: Array, **options: object) -> OptimizeResult:
        calls.append(options)
        options["callback"](intermediate_result=OptimizeResult(fun=misfit_left))  # type: ignore[operator]
        middle = bounds.mean(axis=1)
        return OptimizeResult(x=middle, fun=misfit_left)

    monkeypatch.setattr(reconstruction, "differential_evolution", evolution)
    return calls


def test_a_bad_fit_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    end_with(1234.56, monkeypatch)
    with pytest.raises(
        DesignError, match=r"the fit to the paper's facts ended at a misfit of 1234.6; it must be <= 25"
    ):
        reconstruct()


def test_a_short_evolution_is_a_bad_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """The real thing, stopped after one generation of few members."""
    monkeypatch.setattr(
        reconstruction,
        "differential_evolution",
        lambda *a, **o: differential_evolution(*a, **{**o, "maxiter": 1, "popsize": 2}),
    )
    with pytest.raises(DesignError, match=r"ended at a misfit of [\d.]+; it must be <= 25"):
        reconstruct()


def test_a_fit_is_rounded_and_still_holds_the_static_relation(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = end_with(3.0, monkeypatch)
    heard: list[str] = []
    structure = reconstruct(seed=7, notify=heard.append)
    assert calls[0]["seed"] == 7
    assert heard == ["misfit 3.000"]
    assert structure.spring[0].stiffness == 8.5
    assert structure.beam[0].tip_mass == structure.beam[1].tip_mass == 0.025
    assert structure.beam[2].viscous_damping == structure.patch[3].viscous_damping == 0.031
    model = beam_model(structure, "clamped_free", 10)
    gain, _ = static_gains(model, model.assemble())
    np.testing.assert_allclose(gain @ VOLTAGE, DEFLECTION, rtol=1e-9)


def test_script_writes_the_file_it_is_given(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    end_with(3.0, monkeypatch)
    assert reconstruction.main([str(tmp_path / "mine.toml")]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'mine.toml'}\n"
    assert read_structure(tmp_path / "mine.toml").spring[0].stiffness == 8.5
