"""The kinds of units that a design makes, in the order in which they are listed and built."""

from collections.abc import Iterable

from flexbeams.fmus.units.beam_plant import BEAM_PLANT
from flexbeams.fmus.units.flatness_feedforward import FLATNESS_FEEDFORWARD
from flexbeams.fmus.units.kind import UnitKind
from flexbeams.fmus.units.mfc_actuator import MFC_ACTUATOR
from flexbeams.fmus.units.mfc_compensator import MFC_COMPENSATOR
from flexbeams.fmus.units.tracking_controller import TRACKING_CONTROLLER
from flexbeams.plant.errors import InputError, suggestion

CATALOGUE: tuple[UnitKind, ...] = (
    BEAM_PLANT,
    FLATNESS_FEEDFORWARD,
    TRACKING_CONTROLLER,
    MFC_ACTUATOR,
    MFC_COMPENSATOR,
)


def kind_named(name: str, kinds: Iterable[UnitKind] = CATALOGUE) -> UnitKind | None:
    """The kind of a name; None where there is none."""
    return next((kind for kind in kinds if kind.name == name), None)


def require_kind(name: str, key: str, kinds: Iterable[UnitKind] = CATALOGUE) -> UnitKind:
    """The kind of a name; InputError that names `key` and the valid names where there is none."""
    if (kind := kind_named(name, kinds)) is None:
        raise InputError(key, "is not a unit" + suggestion(name, [k.name for k in kinds]), name)
    return kind
