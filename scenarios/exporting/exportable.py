"""Wirings that other tools step as a run does: Real signals that no connection converts."""

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.runs.prepare import PreparedScenario


def require_exportable(prepared: PreparedScenario) -> None:
    """InputError where a connection converts its value, or a signal drives an input that is not Real."""
    for owner, conversions in prepared.wiring.conversions.items():
        raise InputError(
            "connection",
            "must join equal units of measurement in an export, without factor and offset",
            f"{owner}.{next(iter(conversions))}",
            source=prepared.source,
        )
    for owner, names in prepared.wiring.driven().items():
        variables = prepared.declarations[owner].variables
        for name in names:
            if variables[name].type != "Real" and f"{owner}.{name}" not in prepared.wiring.links():
                rule = f"drives an input of type {variables[name].type}; exports have Real signals only"
                raise InputError("input", rule, f"{owner}.{name}", source=prepared.source)
