"""Kinds of units that a scenario's instances name: those of the catalogue and further ones of the settings."""

from collections.abc import Iterable

from flexbeams.fmus.units.catalogue import CATALOGUE, require_kind
from flexbeams.fmus.units.kind import UnitKind
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.schema import Scenario


def instance_kinds(scenario: Scenario, further: Iterable[UnitKind], source: str) -> dict[str, UnitKind]:
    """The kind of each instance whose unit is built.

    Raises InputError for an unknown unit, and for basis or order of an instance without a plant's model.
    """
    kinds = {}
    known = (*CATALOGUE, *further)
    for name, instance in scenario.instance.items():
        kind = None
        if instance.unit is not None:
            try:
                kind = kinds[name] = require_kind(instance.unit, f"instance.{name}.unit", known)
            except InputError as error:
                raise error.at(source) from None
        if (instance.basis or instance.order) and not (kind and kind.takes_basis):
            takers = " or ".join(kind.name for kind in known if kind.takes_basis)
            raise InputError(f"instance.{name}.basis", f"and order belong to a {takers}", source=source)
    return kinds
