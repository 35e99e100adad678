"""Identification of hysteresis on loops of a foreign structure, and data from which it cannot be identified."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from flexbeams.plant.actuator.operators import hysteresis, move_plays, relax, with_creep
from flexbeams.plant.actuator.parameters import PatchPairActuator, operators
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.plant.identification.actuator_file import pair_text, write_pair
from flexbeams.plant.identification.compensation import commands_for
from flexbeams.plant.identification.hysteresis import HysteresisFit, crept, fit_hysteresis
from flexbeams.plant.identification.loops import LoopColumns, Loops, read_loops, turning_points
from flexbeams.plant.identification.reading import Column
from flexbeams.plant.structure import STRUCTURES_FOLDER, read_structure
from tests.oracles.bouc_wen import FILE, METRES, STEP, bouc_wen, loops, text

KIEL = STRUCTURES_FOLDER / "kiel.toml"


@cache
def fitted() -> HysteresisFit:
    return fit_hysteresis(read_loops(FILE))


def test_the_shipped_data_are_those_of_the_foreign_element() -> None:
    assert FILE.read_text(encoding="utf-8") == text()
    read = read_loops(FILE)
    assert (read.sensor, read.pair, round(read.step, 12)) == ("y_pi[1]", 1, STEP)
    assert len(read.turns) > 15


def test_few_operators_leave_little_of_the_foreign_loop() -> None:
    """5.2 % of the stroke off a line; below 1.5 % are left with at most 12 play operators."""
    fit = fitted()
    assert 0.05 < fit.line < 0.055
    assert fit.largest < 0.015
    assert fit.rms < 0.0025
    assert fit.explained > 0.9999
    assert len(fit.pair.play_weights) <= 12
    assert set(fit.trials) == {2, 4, 6, 8, 10, 12}


def test_a_compensator_of_the_fit_leaves_below_2_percent_of_the_foreign_element() -> None:
    """In simulation: commands for wanted voltages, the element's answer, and what is missed."""
    fit = fitted()
    wanted = 0.72 * loops()
    answer = (METRES * bouc_wen(commands_for(fit.pair, wanted, STEP)) - fit.offset) / fit.gain
    missed = (answer - wanted)[200:] / np.ptp(wanted)  # from the end of the first loop on
    assert np.max(np.abs(missed)) < 0.02
    assert fit.largest_remaining < 0.02
    assert 0.5 < fit.largest_remaining / np.max(np.abs(missed)) < 2.0  # the prediction is of the size of what comes
    assert fit.rms_remaining < 0.005


def response(pair: PatchPairActuator, voltage: Array, step: float) -> Array:
    """u_eff of the project's own operators, in many small steps between the rows."""
    numbers = operators([pair])
    plays, creeps = np.zeros_like(numbers.play_weight), np.zeros_like(numbers.creep_weight)
    out, before = [], 0.0
    for v in voltage.tolist():
        for share in np.arange(1, 11) / 10:
            move_plays(numbers, plays, np.array([before + (v - before) * share]))
            h = hysteresis(numbers, plays)
            relax(numbers, creeps, h, step / 10)
        before = v
        out.append(float(with_creep(numbers, creeps, h)[0]))
    return np.array(out)


def test_own_operators_are_found_again() -> None:
    """Loops of the operators that are fitted, thresholds on the grid of the fit."""
    voltage = loops(0.05)
    pair = PatchPairActuator(
        linear_weight=0.6,
        play_thresholds=[200.0, 400.0, 600.0, 800.0],
        play_weights=[0.2, 0.1, 0.05, 0.02],
        creep_times=[1.0],
        creep_weights=[0.03],
    )
    u_eff = response(pair, voltage, 0.05)
    data = Loops(
        name="own",
        pair=1,
        step=0.05,
        voltage=voltage,
        response=2e-6 * u_eff + 1e-4,
        sensor="y_pi[1]",
        turns=turning_points(voltage),
        first_counted=int(max(np.argmax(voltage), np.argmin(voltage))),
    )
    fit = fit_hysteresis(data, 4)
    assert fit.largest < 2e-3
    scale = fit.gain / 2e-6
    np.testing.assert_allclose(scale * fit.pair.linear_weight, 0.6, rtol=0.02)
    np.testing.assert_allclose(scale * np.array(fit.pair.play_weights), [0.2, 0.1, 0.05, 0.02], atol=0.01)


def test_creep_of_a_line_is_exact() -> None:
    """h = t: c = t - tau (1 - exp(-t / tau)), at every row."""
    t = 0.1 * np.arange(50.0)
    np.testing.assert_allclose(crept(t, 0.7, 0.1), t - 0.7 * -np.expm1(-t / 0.7), atol=1e-14)


def test_the_result_is_a_structure(tmp_path: Path) -> None:
    out = tmp_path / "rig.toml"
    write_pair(KIEL, 2, fitted(), out)
    before, after = read_structure(KIEL), read_structure(out)
    assert before.actuator is not None
    assert after.actuator is not None
    assert after.actuator.pair[1] == fitted().pair
    assert after.actuator.pair[0] == before.actuator.pair[0]
    assert after.beam == before.beam
    assert "# fitted (mfc_loops, residual 1.1 % of the stroke)" in out.read_text(encoding="utf-8")
    assert pair_text(fitted()).startswith("[[actuator.pair]]\nlinear_weight = ")
    with pytest.raises(InputError, match=r"--pair must be a patch pair from 1 to 4, got 5"):
        write_pair(KIEL, 5, fitted(), tmp_path / "none.toml")
    assert not (tmp_path / "none.toml").exists()


def rows(voltage: Array, response: Array, header: str = "time,u[1],y_pi[1]") -> str:
    lines = (
        f"{STEP * k:.2f},{v!r},{y!r}" for k, (v, y) in enumerate(zip(voltage.tolist(), response.tolist(), strict=True))
    )
    return "\n".join([header, *lines, ""])


VOLTAGE, RESPONSE = loops(), METRES * bouc_wen(loops())
GROWING = np.concatenate([0.4 * VOLTAGE[:200], 0.7 * VOLTAGE[:200], VOLTAGE[:160]])


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (lambda: rows(VOLTAGE[:150], RESPONSE[:150]), r"row 52 is the last turning point of the voltage: it must turn"),
        (
            lambda: rows(GROWING, METRES * bouc_wen(GROWING)),
            r"row 552 is where the voltage has first reached both extremes",
        ),
        (
            lambda: rows(VOLTAGE, np.maximum(RESPONSE, -0.006)),
            r"row \d+, y_pi\[1\] is saturated: \d+ rows have one value while the voltage moves by \d+\.?\d* V",
        ),
        (
            lambda: rows(VOLTAGE, 1e-6 * np.arange(len(VOLTAGE)) + 1e-9 * np.sin(np.arange(len(VOLTAGE)))),
            r"row \d+, y_pi\[1\] the response drifts or is noise: the voltage must explain more than 50%",
        ),
        (lambda: rows(VOLTAGE / 1e3, RESPONSE), r"row 52 the voltage must span at least 20 V \(in kV\?"),
        (lambda: rows(VOLTAGE, 1e3 * RESPONSE), r"row \d+, y_pi\[1\] must be within 0.5 m \(in mm\? then --map"),
        (lambda: rows(VOLTAGE, RESPONSE, "time,u[1],z"), r"column of a sensor is missing; y_pi\[k\] are deflections"),
        (lambda: rows(VOLTAGE, RESPONSE, "time,volts,y_pi[1]"), r"column 'u\[1\]' is missing"),
        (lambda: rows(0 * VOLTAGE, RESPONSE), r"column 'u\[1\]' must change"),
        (lambda: rows(VOLTAGE, RESPONSE).replace("0.40,", "0.41,", 1), r"row 22, column 'time' must have even steps"),
        (
            lambda: rows(VOLTAGE, RESPONSE).replace("\n0.40,", "\n0.40,x", 1),
            r"row 22, column 'u\[1\]' must be a finite",
        ),
    ],
    ids=["turns", "loop", "saturated", "drift", "kilovolts", "mm", "sensor", "voltage", "constant", "time", "cell"],
)
def test_bad_data_are_refused_with_row_and_reason(content: Callable[[], str], reason: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(content(), encoding="utf-8")
    with pytest.raises(InputError, match=reason) as refusal:
        read_loops(path)
    assert str(refusal.value).startswith(str(path))
    assert read_loops(FILE).stroke > 0.01


def test_columns_may_be_named_and_scaled(tmp_path: Path) -> None:
    path = tmp_path / "rig.csv"
    path.write_text(rows(VOLTAGE / 1e3, 1e3 * RESPONSE, "t,kv,laser"), encoding="utf-8")
    mapping = {
        "time": Column(name="t"),
        "u[3]": Column(name="kv", factor=1e3),
        "y_pi[2]": Column(name="laser", factor=1e-3),
    }
    read = read_loops(path, LoopColumns(pair=3, sensor="y_pi[2]", mapping=mapping))
    np.testing.assert_allclose(read.voltage, VOLTAGE, rtol=1e-12)
    np.testing.assert_allclose(read.response, RESPONSE, rtol=1e-12)
    assert (read.pair, read.sensor) == (3, "y_pi[2]")
