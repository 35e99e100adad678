"""Units of many beams: a chain of twelve with default options. FLEXBEAMS_BEAMS lists other numbers of beams."""

import os
from pathlib import Path

import numpy as np
import pytest

from flexbeams.controller.design import compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.scenarios.api.units import build
from flexbeams.scenarios.validation.references import reference_checks
from tests.native.workshop import needs_zig
from tests.oracles.chains import chain_of_beams

BEAMS = [int(count) for count in os.environ.get("FLEXBEAMS_BEAMS", "12").split(",")]


@needs_zig
@pytest.mark.parametrize("beams", BEAMS)
def test_the_feedforward_reproduces_its_references(beams: int, tmp_path: Path) -> None:
    """Degree 10 r: a transition and another target on the way, finite and as the Python series give them, to 1e-9."""
    made = compute_design(chain_of_beams(beams), DesignOptions(verify="design"))
    [file] = build(made, ["FlatnessFeedforward"], folder=tmp_path)
    assert file.stat().st_size < 1_000_000 * beams**2 / 36
    checks = reference_checks(file)
    assert [check.message.partition(":")[0] for check in checks] == ["reference transition", "reference retarget"]
    assert all(check.passed for check in checks)
    assert np.all(np.isfinite(made.arrays["mode_states"]))
