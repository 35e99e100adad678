"""What the files of a figure depend on, so that a run need not draw again what an earlier one has drawn."""

import hashlib
import pickle
from dataclasses import replace
from pathlib import Path

from flexbeams.plant.versions import installed_version
from flexbeams.scenarios.report.plots import Plot

_DRAWN_BY = Path(__file__).with_name("figures.py")


def drawing_hash(plot: Plot) -> str:
    """Hash of a figure's content and of what draws it; equal ones have equal files, whatever their names."""
    digest = hashlib.sha256(f"matplotlib {installed_version('matplotlib')}".encode() + _DRAWN_BY.read_bytes())
    digest.update(pickle.dumps(replace(plot, stem=Path()), protocol=5))
    return digest.hexdigest()
