"""Recorded signals as tables of pandas and xarray, which are imported when they are needed."""

from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.results.curves import quantity_of
from flexbeams.scenarios.simulation.recording import Recording

# Dimension of the elements of an array, by its quantity
_DIMENSIONS = {"deflection": "point", "voltage": "patch_pair", "strain": "gauge", "force": "beam"}


def _library(name: str) -> Any:
    """A library of a named extra; InputError where it is not installed."""
    try:
        return import_module(name)
    except ImportError:
        raise InputError(f"to_{name}", f"needs the package {name} (pip install 'flexbeams[{name}]')") from None


def to_pandas(recording: Recording, units: Mapping[str, str]) -> Any:
    """A DataFrame of the columns over the index `time`, s; units of measurement in its attribute `units`."""
    pandas = _library("pandas")
    index = pandas.Index(recording.time, name="time")
    frame = pandas.DataFrame(recording.values, index=index, columns=recording.columns)
    frame.attrs["units"] = {"time": "s", **{column: units[column] for column in recording.columns}}
    return frame


def to_xarray(time: Array, arrays: Mapping[str, Array], units: Mapping[str, str], attributes: Mapping[str, str]) -> Any:
    """A Dataset of the arrays over `time`, s, with elements counted from 1."""
    xarray = _library("xarray")
    sizes: dict[str, int] = {}
    variables = {}
    for name, values in arrays.items():
        dimensions = _dimensions(name, values, sizes)
        sizes |= dict(zip(dimensions, values.shape[1:], strict=True))
        variables[name] = (("time", *dimensions), values, {"units": units[name]})
    numbers = {dimension: np.arange(1, size + 1) for dimension, size in sizes.items()}
    coordinates = {"time": ("time", time, {"units": "s"}), **numbers}
    return xarray.Dataset(variables, coords=coordinates, attrs=dict(attributes))


def _dimensions(name: str, values: Array, sizes: Mapping[str, int]) -> tuple[str, ...]:
    """Names of the dimensions behind the time; an array whose sizes are others than those of its quantity has own."""
    base = name.rpartition(".")[2]
    if values.ndim == 3:
        return ("beam", "station") if base == "w" else (f"{name}.row", f"{name}.column")
    if values.ndim == 1:
        return ()
    dimension = _DIMENSIONS.get(quantity_of(base), f"{name}.index")
    return (dimension if sizes.get(dimension, values.shape[1]) == values.shape[1] else f"{name}.index",)
