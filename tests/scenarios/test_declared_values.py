"""What declarations say of names, values, types and units of measurement, at the limits of each rule."""

from types import SimpleNamespace
from typing import Any

import pytest

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.compatibility import joined
from flexbeams.scenarios.definition.declaration import by_index, element_names, is_settable, split_owner
from flexbeams.scenarios.definition.dimensions import (
    IDENTITY,
    KNOWN_DIMENSIONS,
    OWN_DIMENSIONS,
    Conversion,
    Dimension,
    conversion,
    si_unit,
)
from flexbeams.scenarios.definition.settings import require_undriven
from flexbeams.scenarios.definition.values import own_start, require_bounds, require_value, value_of_text

LENGTH, TEMPERATURE = (0, 1, 0, 0, 0, 0, 0, 0), (0, 0, 0, 0, 1, 0, 0, 0)
UNITS = {
    "m": Dimension(exponents=LENGTH),
    "cm": Dimension(exponents=LENGTH, factor=0.01),
    "mm": Dimension(exponents=LENGTH, factor=0.001),
    "inch": Dimension(exponents=LENGTH, factor=0.0254),
    "K": Dimension(exponents=TEMPERATURE),
    "degC": Dimension(exponents=TEMPERATURE, offset=273.15),
    "degF": Dimension(exponents=TEMPERATURE, factor=5 / 9, offset=459.67 * 5 / 9),
}


def variable(kind: str, items: dict[str, int] | None = None, **more: Any) -> Any:
    """A variable as FMPy has it."""
    declared = None
    if items is not None:
        declared = SimpleNamespace(items=[SimpleNamespace(name=n, value=str(k)) for n, k in items.items()])
    given = {"name": "x", "min": None, "max": None, "start": None, "unit": None, "causality": "input", **more}
    return SimpleNamespace(type=kind, declaredType=declared, **given)


def test_elements_go_by_all_their_indices() -> None:
    names = ["w[10]", "w[2]", "w[1,2]", "w[1,10]", "w[1]", "w[1].u[2]", "w[1].v", "ww[1]", "w"]
    assert element_names([n for n in names if n != "w"], "w") == ["w[1]", "w[1,2]", "w[1,10]", "w[2]", "w[10]"]
    assert element_names(names, "w") == ["w"]
    assert element_names(names, "w[1]") == ["w[1]"]
    assert element_names(names, "w[1].u") == ["w[1].u[2]"]
    assert element_names(names, "v") == []
    assert by_index(["b[2].m[1]", "b[10].m[1]", "b[1].m[2]", "b[1].m[1]"]) == [
        "b[1].m[1]",
        "b[1].m[2]",
        "b[2].m[1]",
        "b[10].m[1]",
    ]


def test_the_longest_instance_owns_a_name() -> None:
    owners = ("a", "a.b", "ab")
    assert split_owner("a.b.c[1]", owners) == ("a.b", "c[1]")
    assert split_owner("a.c.b", owners) == ("a", "c.b")
    assert split_owner("ab.c", owners) == ("ab", "c")
    assert split_owner("z.c.d", owners) == ("z", "c.d")


@pytest.mark.parametrize(
    ("causality", "initial", "variability", "settable"),
    [
        ("parameter", "exact", "fixed", True),
        ("input", None, "continuous", True),
        ("local", "exact", "continuous", True),
        ("local", "approx", "continuous", True),
        ("output", "approx", "discrete", True),
        ("local", "calculated", "continuous", False),
        ("output", None, "continuous", False),
        ("local", "exact", "constant", False),
    ],
)
def test_what_takes_a_start_value(causality: str, initial: str | None, variability: str, settable: bool) -> None:
    assert is_settable(variable("Real", causality=causality, initial=initial, variability=variability)) is settable


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        ("Boolean", " 1 ", True),
        ("Boolean", "0", False),
        ("Boolean", "\ttrue\n", True),
        ("Boolean", "false", False),
        ("Integer", " -7 ", -7),
        ("Real", " 1e-3 ", 1e-3),
        ("String", " two ", " two "),
        ("Enumeration", " on ", 2),
        ("Enumeration", "5", 5),
        ("Enumeration", "+2", 2),
    ],
)
def test_texts_of_documents(kind: str, text: str, value: object) -> None:
    found = value_of_text(variable(kind, {"off": 1, "on": 2, "auto": 5}), text)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("kind", "text"),
    [("Boolean", "yes"), ("Boolean", ""), ("Boolean", "True"), ("Integer", "1.0"), ("Enumeration", "3"), ("Real", "")],
)
def test_texts_that_are_no_values(kind: str, text: str) -> None:
    with pytest.raises(ValueError, match=r".+"):
        value_of_text(variable(kind, {"off": 1, "on": 2, "auto": 5}), text)


def test_own_start_values_are_signals() -> None:
    assert own_start(variable("Boolean", start="true")) == 1.0
    assert own_start(variable("Enumeration", {"off": 1, "on": 2}, start="2")) == 2.0
    assert own_start(variable("Real", start="-2.5")) == -2.5
    assert own_start(variable("String", start="5")) == 0.0
    assert own_start(variable("Real")) == 0.0


def test_bounds_belong_to_the_range() -> None:
    bounded = variable("Real", min="-1.5", max="2")
    for value in (-1.5, 0.0, 2.0):
        require_bounds("k", bounded, value)
    for value in (-1.5000001, 2.0000001):
        with pytest.raises(InputError, match=r"k must be from -1\.5 to 2, got"):
            require_bounds("k", bounded, value)
    require_bounds("k", variable("Real", min=0.0), 1e300)
    require_bounds("k", variable("Real", max=0.0), -1e300)


@pytest.mark.parametrize(
    ("value", "legal"), [(2**31 - 1, True), (2**31, False), (-(2**31), True), (-(2**31) - 1, False)]
)
def test_integers_have_32_bits(value: int, legal: bool) -> None:
    if legal:
        assert require_value("k", variable("Integer"), float(value)) == value
    else:
        with pytest.raises(InputError, match="must be of type Integer"):
            require_value("k", variable("Integer"), float(value))


@pytest.mark.parametrize(
    ("one", "other", "values"),
    [
        ("degC", "K", {20.0: 293.15, -273.15: 0.0}),
        ("K", "degC", {293.15: 20.0, 0.0: -273.15}),
        ("degC", "degF", {100.0: 212.0, -40.0: -40.0}),
        ("degF", "degC", {212.0: 100.0, 32.0: 0.0}),
        ("inch", "mm", {1.0: 25.4}),
        ("mm", "inch", {25.4: 1.0}),
    ],
)
def test_conversions_with_factors_and_offsets(one: str, other: str, values: dict[float, float]) -> None:
    found = conversion(one, other, UNITS, UNITS)
    assert isinstance(found, Conversion)
    for value, expected in values.items():
        assert found.factor * value + found.offset == pytest.approx(expected, rel=1e-12, abs=1e-10)


def test_powers_of_ten_are_exact() -> None:
    for one, other, factor in (("m", "mm", 1000.0), ("cm", "mm", 10.0), ("mm", "cm", 0.1), ("cm", "m", 0.01)):
        assert conversion(one, other, UNITS, UNITS) == Conversion(factor=factor, offset=0.0)
    for one, other, factor in (("mm", "µm", 1000.0), ("m", "nm", 1e9), ("µm", "cm", 1e-4)):
        assert conversion(one, other, KNOWN_DIMENSIONS, KNOWN_DIMENSIONS) == Conversion(factor=factor, offset=0.0)
    assert conversion("inch", "cm", UNITS, UNITS) == Conversion(factor=2.54, offset=0.0)


def test_units_that_are_open_equal_or_unknown() -> None:
    for one, other in (("", "m"), ("m", ""), ("", ""), ("m", "m"), ("furlong", "furlong")):
        assert conversion(one, other, UNITS, UNITS) == IDENTITY
    same = {"metre": Dimension(exponents=LENGTH)}
    assert conversion("metre", "m", same, UNITS) == IDENTITY
    assert "'furlong' has no definition" in str(conversion("furlong", "m", UNITS, UNITS))
    assert "'furlong' has no definition" in str(conversion("m", "furlong", UNITS, UNITS))
    assert "different quantities" in str(conversion("m", "K", UNITS, UNITS))


def test_known_units_are_multiples_of_si() -> None:
    assert (si_unit("µm/m"), si_unit("ms"), si_unit("m"), si_unit("?")) == ("1", "s", "m", "?")
    for name, dimension in KNOWN_DIMENSIONS.items():
        assert dimension.exponents == OWN_DIMENSIONS[si_unit(name)].exponents
    for name, size in (("mm", 1e-3), ("kV", 1e3), ("%", 1e-2), ("g", 1e-3), ("GPa", 1e9), ("min", 60.0), ("mN", 1e-3)):
        assert conversion(name, si_unit(name), KNOWN_DIMENSIONS, KNOWN_DIMENSIONS) == Conversion(
            factor=size, offset=0.0
        )


ITEMS = {"off": 1, "on": 2}


@pytest.mark.parametrize(
    ("start", "end", "fits"),
    [
        (variable("Real"), variable("Real"), True),
        (variable("Integer"), variable("Real"), True),
        (variable("Real"), variable("Integer"), False),
        (variable("Enumeration", ITEMS), variable("Integer"), True),
        (variable("Enumeration", ITEMS), variable("Real"), False),
        (variable("Integer"), variable("Enumeration", ITEMS), False),
        (variable("Boolean"), variable("Boolean"), True),
        (variable("Boolean"), variable("Integer"), False),
        (variable("Enumeration", ITEMS), variable("Enumeration", ITEMS), True),
        (variable("Enumeration", ITEMS), variable("Enumeration", {"off": 1, "on": 3}), False),
        (variable("Enumeration", ITEMS), variable("Enumeration", {"off": 1}), False),
        (variable("Enumeration"), variable("Enumeration", ITEMS), True),  # items are not stated
    ],
)
def test_which_types_are_joined(start: Any, end: Any, fits: bool) -> None:
    assert isinstance(joined(start, end, {}, {}), Conversion) is fits


def test_a_factor_is_for_real_inputs() -> None:
    given = Conversion(factor=2.0, offset=0.0)
    assert joined(variable("Real"), variable("Real"), {}, {}, given) == given
    assert joined(variable("Integer"), variable("Real"), {}, {}, given) == given
    for kind in ("Integer", "Boolean"):
        assert "must have no factor and offset" in str(joined(variable(kind), variable(kind), {}, {}, given))
        assert joined(variable(kind), variable(kind), {}, {}, IDENTITY) == IDENTITY


@pytest.mark.parametrize(
    ("key", "refused"),
    [
        ("a.u", True),
        ("a.u[1]", True),
        ("a.u[2]", False),
        ("a.v", False),
        ("a.b.w[]", True),
        ("a.b.w", True),
        ("a.uu", False),
    ],
)
def test_driven_inputs_are_not_set(key: str, refused: bool) -> None:
    driven = {"a": ["u[1]"], "a.b": ["w[1]", "w[2]"]}
    if refused:
        with pytest.raises(InputError, match="must not set an input that the scenario drives"):
            require_undriven({key: 1.0}, driven)
    else:
        require_undriven({key: 1.0}, driven)
