"""FMI 2.0 co-simulation units of a flexible structure and its control.

The package maps to four folders of the project: `plant` (physics), `controller` (control), `fmus` (units) and
`scenarios` (runs). Imports point down that list only.
"""

from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]
if (_ROOT / "plant" / "galerkin.py").is_file():  # a checkout: its own folders, whatever else is installed
    __path__.append(str(_ROOT))

try:
    __version__ = version("flexbeams")
except PackageNotFoundError:  # a checkout on the path that is not installed
    __version__ = "0+unknown"
