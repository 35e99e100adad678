"""FMI 2.0 co-simulation units of a flexible structure and its control.

The package maps to four folders of the project: `plant` (physics), `controller` (control), `fmus` (units) and
`scenarios` (runs). Imports point down that list only. The public names are imported when they are first used.
"""

import os

TYPE_CHECKING = False
if TYPE_CHECKING:
    from flexbeams.plant.errors import FlexbeamsError
    from flexbeams.scenarios.api.comparisons import compare
    from flexbeams.scenarios.api.designs import design, structure
    from flexbeams.scenarios.api.exports import export
    from flexbeams.scenarios.api.hysteresis import identify_hysteresis
    from flexbeams.scenarios.api.identifications import identify
    from flexbeams.scenarios.api.runs import load, run
    from flexbeams.scenarios.api.simulations import simulation
    from flexbeams.scenarios.api.studies import study
    from flexbeams.scenarios.api.units import build
    from flexbeams.scenarios.learning.registration import register_environments

    __version__: str

__all__ = [
    "FlexbeamsError",
    "__version__",
    "build",
    "compare",
    "design",
    "export",
    "identify",
    "identify_hysteresis",
    "load",
    "register_environments",
    "run",
    "simulation",
    "structure",
    "study",
]

_MODULES = {
    "FlexbeamsError": "flexbeams.plant.errors",
    "build": "flexbeams.scenarios.api.units",
    "compare": "flexbeams.scenarios.api.comparisons",
    "design": "flexbeams.scenarios.api.designs",
    "export": "flexbeams.scenarios.api.exports",
    "identify": "flexbeams.scenarios.api.identifications",
    "identify_hysteresis": "flexbeams.scenarios.api.hysteresis",
    "load": "flexbeams.scenarios.api.runs",
    "register_environments": "flexbeams.scenarios.learning.registration",
    "run": "flexbeams.scenarios.api.runs",
    "simulation": "flexbeams.scenarios.api.simulations",
    "structure": "flexbeams.scenarios.api.designs",
    "study": "flexbeams.scenarios.api.studies",
}
_ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
if os.path.isfile(os.path.join(_ROOT, "plant", "galerkin.py")):  # a checkout: its own folders, whatever else there is
    __path__.append(_ROOT)


def __getattr__(name: str) -> object:
    if name == "__version__":
        value: object = _version()
    elif name in _MODULES:
        from importlib import import_module

        value = getattr(import_module(_MODULES[name]), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("flexbeams")
    except PackageNotFoundError:  # a checkout on the path that is not installed
        return "0+unknown"
