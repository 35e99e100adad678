"""FMI 2.0 co-simulation units of a flexible structure and its control.

The package maps to four folders of the project: `plant` (physics), `controller` (control), `fmus` (units) and
`scenarios` (runs). Imports point down that list only. Nothing is imported before it is used.
"""

import os

_ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
if os.path.isfile(os.path.join(_ROOT, "plant", "galerkin.py")):  # a checkout: its own folders, whatever else there is
    __path__.append(_ROOT)


def __getattr__(name: str) -> str:
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib.metadata import PackageNotFoundError, version

    try:
        found = version("flexbeams")
    except PackageNotFoundError:  # a checkout on the path that is not installed
        found = "0+unknown"
    globals()[name] = found
    return found
