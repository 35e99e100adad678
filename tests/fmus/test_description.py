"""The interface table and modelDescription.xml, held against FMI's schema and rules by FMPy."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest

from flexbeams.fmus.documents.description import content_guid, model_description
from flexbeams.fmus.errors import InterfaceError
from flexbeams.fmus.interface.si import SI_UNITS
from flexbeams.fmus.interface.variables import TIME, Interface, Variable, array, matrix
from tests.units.lag_interface import lag_interface


def parsed(folder: Path, interface: Interface, **options: Any) -> Any:
    content = model_description(interface, guid=content_guid(b""), **options)
    (folder / "modelDescription.xml").write_bytes(content)
    return fmpy.read_model_description(
        folder, validate=True, validate_variable_names=True, validate_model_structure=True
    )


def test_description_satisfies_schema_names_and_structure(tmp_path: Path) -> None:
    description = parsed(tmp_path, lag_interface(), version="1.2", license="MIT", source_files=["a.c", "b.c"])
    assert b'<File name="a.c" />' in (tmp_path / "modelDescription.xml").read_bytes()
    assert (description.version, description.license, description.author) == ("1.2", "MIT", "flexbeams contributors")
    assert description.generationDateAndTime is None


def test_variables_come_back_as_declared(tmp_path: Path) -> None:
    interface = lag_interface()
    description = parsed(tmp_path, interface)
    assert description.description == interface.description
    assert [v.name for v in description.modelVariables] == [v.name for v in interface]
    for reference, (read, declared) in enumerate(zip(description.modelVariables, interface, strict=True)):
        assert read.valueReference == reference
        assert (read.type, read.causality, read.variability) == (
            declared.type,
            declared.causality,
            declared.variability,
        )
        assert (read.unit, read.description or "") == (declared.unit, declared.description)
        assert read.min == (None if declared.minimum is None else str(declared.minimum))


def test_start_values_survive_bit_for_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    bits = rng.integers(0, 2**63, 200, dtype=np.uint64).view(np.float64)
    starts = [0.1 + 0.2, 5e-324, 1.7976931348623157e308, -0.0, *bits[np.isfinite(bits)]]
    table = (TIME, *array("p", len(starts), causality="parameter", start=np.array(starts)))
    description = parsed(tmp_path, replace(lag_interface(), variables=table))
    read = [float(v.start) for v in description.modelVariables[1:]]
    assert np.array(read).tobytes() == np.array(starts).tobytes()


def test_outputs_depend_on_no_input_and_initially_on_parameters_and_named_inputs(tmp_path: Path) -> None:
    description = parsed(tmp_path, lag_interface())
    assert all(unknown.dependencies == [] for unknown in description.outputs)
    numbers = [v for v in description.modelVariables if v.causality == "parameter" and v.type != "String"]
    inputs = [v for v in description.modelVariables if v.causality == "input"]
    assert len(description.initialUnknowns) == len(description.outputs)
    for unknown in description.initialUnknowns:
        named = inputs if unknown.variable.name.startswith("y") else []
        assert unknown.dependencies == [*named, *numbers]


def test_description_is_the_same_bytes_every_time() -> None:
    assert model_description(lag_interface(), guid="g") == model_description(lag_interface(), guid="g")


def factors(name: str) -> dict[str, int]:
    """SI powers of a compound unit from those of its factors: N.s/m2 is N times s over m squared."""
    powers: dict[str, int] = {}
    above, _, below = name.partition("/")
    for part, sign in ((above, 1), (below, -1)):
        for factor in filter(None, part.split(".")):
            symbol, digits = re.fullmatch(r"([A-Za-z]+|1)(\d*)", factor).groups()  # type: ignore[union-attr]
            known = {"C": {"A": 1, "s": 1}, **SI_UNITS}
            for base, power in known[symbol].items():
                powers[base] = powers.get(base, 0) + sign * int(digits or 1) * power
    return {base: power for base, power in powers.items() if power}


@pytest.mark.parametrize("name", [name for name in SI_UNITS if not name.isalnum()])
def test_compound_units_are_the_product_of_their_factors(name: str) -> None:
    assert SI_UNITS[name] == factors(name)


def test_volt_newton_pascal_joule_are_consistent() -> None:
    assert SI_UNITS["J"] == factors("N.m")
    assert SI_UNITS["Pa"] == factors("N/m2")
    assert SI_UNITS["N"] == factors("kg.m") | {"s": -2}
    assert factors("V.C") == SI_UNITS["J"]


def test_guid_depends_on_every_content_and_on_where_it_ends() -> None:
    guids = {content_guid(*c) for c in ([b"ab"], [b"a", b"b"], [b"", b"ab"], [b"b", b"a"], [b"ab", b""])}
    assert len(guids) == 5
    assert all(re.fullmatch(r"\{[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}\}", guid) for guid in guids)


def test_interface_survives_json() -> None:
    interface = lag_interface()
    again = Interface.from_json(interface.to_json())
    assert again == interface
    assert again.to_json() == interface.to_json()


def test_arrays_are_contiguous_ranges_of_value_references() -> None:
    interface = replace(
        lag_interface(),
        variables=(
            TIME,
            *array("beam[].tip_mass", 2, causality="parameter", start=[0.02, 0.03], unit="kg"),
            Variable(name="energy", unit="J"),
            *matrix("w", 2, 3, unit="m"),
        ),
    )
    assert [v.name for v in interface][1:3] == ["beam[1].tip_mass", "beam[2].tip_mass"]
    assert interface["beam[2].tip_mass"].start == 0.03
    assert interface.references("beam[].tip_mass") == range(1, 3)
    assert interface.references("energy") == range(3, 4)
    assert interface.references("w") == range(4, 10)
    assert interface.reference("w[2,1]") == 7
    with pytest.raises(KeyError, match="nothing"):
        interface.references("nothing")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"name": "u[0]"}, "indices from 1, got 'u\\[0\\]'"),
        ({"name": "1u"}, "must be structured"),
        ({"type": "Enumeration"}, "type must be one of Real"),
        ({"type": "Integer", "variability": "continuous"}, "variability must be discrete"),
        ({"causality": "output", "variability": "fixed"}, "must be a pair FMI allows"),
        ({"causality": "output", "initial": "approx"}, "initial must be one of"),
        ({"causality": "input"}, "start must be given, got None"),
        ({"causality": "output", "start": 1.0}, "start must be absent for this output, got 1.0"),
        ({"causality": "parameter", "start": float("nan")}, "start must be a finite number, got nan"),
        ({"causality": "parameter", "start": True}, "start must be a finite number, got True"),
        ({"causality": "parameter", "start": 2.0, "maximum": 1.0}, r"within \[-inf, 1.0\], got 2.0"),
        ({"causality": "parameter", "type": "Integer", "start": 1.5}, "a 32-bit integer, got 1.5"),
        ({"causality": "parameter", "type": "Integer", "start": 2**31}, "a 32-bit integer, got 2147483648"),
        ({"causality": "parameter", "type": "String", "start": 1.0}, "start must be a String, got 1.0"),
        ({"causality": "parameter", "type": "Boolean", "start": 1}, "start must be a Boolean, got 1"),
        ({"type": "Boolean", "minimum": 0.0}, "minimum must be absent for Boolean"),
        ({"minimum": 2.0, "maximum": 1.0}, "minimum must be <= maximum 1.0, got 2.0"),
        ({"nominal": 0.0}, "nominal must be > 0, got 0.0"),
        ({"type": "Integer", "unit": "m"}, "absent for Integer"),
        ({"causality": "output", "initial": "exact", "start": 0.0, "initial_inputs": ("u",)}, "absent unless"),
        ({"unit": "furlong"}, "unit must be one of .*, got 'furlong'"),
    ],
)
def test_illegal_variables_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(InterfaceError, match=message):
        Variable(**{"name": "x", **wrong})


@pytest.mark.parametrize(
    ("variables", "message"),
    [
        ((Variable(name="x"),), "first variable must be time"),
        ((TIME, Variable(name="x"), Variable(name="x")), "names must be unique, got x twice"),
        ((TIME, *array("x", 2), Variable(name="z"), Variable(name="x[3]")), "x must be contiguous"),
        ((TIME, Variable(name="x"), *array("x", 2, causality="output")), "must be of one kind"),
        ((TIME, Variable(name="x"), Variable(name="z", initial_inputs=("x",))), "must name inputs, got 'x'"),
        ((TIME, Variable(name="z", initial_inputs=("v",))), "z: initial_inputs must name inputs, got 'v'"),
    ],
)
def test_illegal_tables_are_refused(variables: tuple[Variable, ...], message: str) -> None:
    with pytest.raises(InterfaceError, match=message):
        replace(lag_interface(), variables=variables)


def test_start_of_wrong_length_is_refused() -> None:
    with pytest.raises(InterfaceError, match="u: start must be one value or 3 of them"):
        array("u", 3, causality="input", start=[1.0, 2.0])
