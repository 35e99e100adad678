"""Names that a user chooses from, in a module that imports nothing heavy: the options of the command line need them."""

from typing import Literal, get_args

from flexbeams.fmus.choices import BACKENDS, Backend
from flexbeams.plant.choices import BASES, BasisName

Coupling = Literal["jacobi", "gauss-seidel"]
COUPLINGS: tuple[Coupling, ...] = get_args(Coupling)
Format = Literal["csv", "parquet", "mat", "mf4"]
FORMATS: tuple[Format, ...] = get_args(Format)
ExportFormat = Literal["ssp", "ospsystem", "closed-loop", "container", "wiring"]
EXPORT_SUFFIXES: dict[ExportFormat, str] = {  # of the file or folder
    "ssp": ".ssp",
    "ospsystem": "_osp",
    "closed-loop": ".fmu",
    "container": ".fmu",
    "wiring": "_units",
}
EXPORT_OPTIONS: dict[str, tuple[ExportFormat, ...]] = {  # options of single formats
    "ssp_version": ("ssp",),
    "parts": ("closed-loop",),
    "with_signals": ("closed-loop",),
    "wiring": ("wiring",),
    "flags_as_real": ("ssp", "ospsystem", "closed-loop", "wiring"),
}
WIRING_TOOLS = ("veos", "simulink", "dymola", "mastersim", "te1420")
Method = Literal["lhs", "sobol", "saltelli", "grid"]
METHODS: tuple[Method, ...] = get_args(Method)
SspVersion = Literal["1.0", "2.0"]
SSP_VERSIONS: tuple[SspVersion, ...] = get_args(SspVersion)

__all__ = [
    "BACKENDS",
    "BASES",
    "COUPLINGS",
    "EXPORT_OPTIONS",
    "EXPORT_SUFFIXES",
    "FORMATS",
    "METHODS",
    "SSP_VERSIONS",
    "WIRING_TOOLS",
    "Backend",
    "BasisName",
    "Coupling",
    "ExportFormat",
    "Format",
    "Method",
    "SspVersion",
]
