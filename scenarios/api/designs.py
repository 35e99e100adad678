"""Structures and designs by name or file."""

from pathlib import Path
from typing import Any

from flexbeams.controller.design import compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.plant.structure import Structure, find_structure, read_structure
from flexbeams.plant.validation import validate
from flexbeams.scenarios.api.design_view import DesignView


def structure(name: str | Path = "kiel") -> Structure:
    """The structure of a shipped name or of a file.

    Parameters
    ----------
    name
        `kiel`, `single_beam`, `five_beams`, or the path of a structure file.

    Raises
    ------
    InputError
        Where there is no such structure, or a value of the file breaks a rule.

    Examples
    --------
    >>> import flexbeams as fb
    >>> kiel = fb.structure("kiel")
    >>> len(kiel.beam), kiel.beam[0].length
    (3, 0.4)
    """
    return read_structure(find_structure(str(name)))


def design(structure: str | Path | Structure = "kiel", **options: Any) -> DesignView:
    """Computes the design of a structure: reduced model, flatness coefficients, filter and regulator.

    Parameters
    ----------
    structure
        A shipped name, the path of a structure file, or a structure.
    options
        Keys of the table `[design]` of a scenario, such as `basis`, `order`, `reduced_modes`, and `weights` as a table.

    Returns
    -------
    DesignView
        The design, with its plants, models, controller and closed loops.

    Raises
    ------
    InputError
        For an unknown structure or option, and for a value that breaks a rule.
    DesignError
        Where a step of the design has no acceptable result.

    Examples
    --------
    >>> import flexbeams as fb
    >>> fb.design("single_beam", reduced_modes=4).summary["reduced_order"]
    8
    """
    chosen = structure if isinstance(structure, Structure) else _read(structure)
    return DesignView(compute_design(chosen, validate(DesignOptions, options, "design")))


_read = structure
