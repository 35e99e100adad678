"""The tables of the C plant: what it computes its matrices and outputs from, without the zeros of a chain of beams."""

import numpy as np
from numpy.typing import NDArray

from flexbeams.fmus.interface.variables import Interface
from flexbeams.fmus.units.native_kernel import Fields, Records, Table, UnitData, first_references
from flexbeams.plant.basis import Array

_MATRICES = {"M": "MASS", "D": "DAMPING", "K": "STIFFNESS", "L": "INPUT_GAIN"}  # in C


def native_data(interface: Interface, data: UnitData) -> Fields:
    """The fields of BeamPlantData."""
    meta, arrays = data.meta, data.arrays
    n, beams = int(meta["size"]), len(arrays["tips"])
    points, gauges, stations = (len(interface.references(name)) for name in ("y_pi", "y_pm", "w"))
    terms, rows, blocks = _native_terms(data)
    parameters = [
        {"reference": reference, "may_vanish": name in meta["may_vanish"]}
        for name, reference in meta["parameters"].items()
    ]
    return {
        "coordinates": n,
        "patches": len(interface.references("u")),
        "beams": beams,
        "points": points,
        "gauges": gauges,
        "stations": stations,
        "parameter_count": len(parameters),
        "term_count": len(terms),
        **first_references(
            interface, "u", "force", "y_pi", "energy", "start_at_rest_under", "strain_noise_std", "noise_seed"
        ),
        "parameters": Records(
            type="PlantParameter", rows=parameters, comment="the physical parameters, by value reference"
        ),
        "terms": Records(
            type="PlantTerm", rows=terms, comment="what each parameter adds to the matrices of M q'' + D q' + K q = L u"
        ),
        "rows": Table(values=rows, comment="rows of the matrices that terms are added to, each set of rows once"),
        "blocks": Table(
            values=blocks,
            comment="the blocks of the terms one after the other, each row by row, for a parameter of 1 in SI units",
        ),
        "outputs": _sparse_rows(
            np.vstack([arrays["outputs"], arrays["tips"]]),
            f"per coordinate, ({points + gauges + stations + beams}, {n}): deflections y_pi, 1, strains y_pm, 1/m, "
            "deflections w of the stations and of the tips, 1",
        ),
    }


def _native_terms(data: UnitData) -> tuple[list[Fields], NDArray[np.uint32], Array]:
    """Terms without rows and columns of zeros, which most blocks of one patch pair or of a spring consist of."""
    terms: list[Fields] = []
    rows: dict[tuple[int, ...], int] = {}  # sets of rows, and where each begins
    blocks: list[Array] = []
    for k, (name, matrix, start, column) in enumerate(data.meta["terms"]):
        block = data.arrays[f"term_{k}"]
        places = np.flatnonzero(np.any(block != 0, axis=1))
        numbers = tuple((start + places).tolist())
        terms.append(
            {
                "parameter": data.meta["parameters"][name],
                "matrix": _MATRICES[matrix],
                "column": column,
                "size": len(numbers),
                "rows": rows.setdefault(numbers, sum(map(len, rows))),
                "block": sum(b.size for b in blocks),
            }
        )
        blocks.append(block[places] if matrix == "L" else block[np.ix_(places, places)])
    return (
        terms,
        np.array([n for numbers in rows for n in numbers], np.uint32),
        np.concatenate([b.ravel() for b in blocks]),
    )


def _sparse_rows(rows: Array, meaning: str) -> Fields:
    """The fields of SparseRows."""
    present = rows != 0
    return {
        "starts": Table(
            values=np.concatenate([[0], np.cumsum(present.sum(axis=1))]).astype(np.uint32),
            comment="first entry of each row of the outputs, and the number of entries",
        ),
        "columns": Table(values=np.nonzero(present)[1].astype(np.uint32), comment="coordinate of each entry"),
        "values": Table(values=rows[present], comment=f"entries that are not 0 {meaning}"),
    }
