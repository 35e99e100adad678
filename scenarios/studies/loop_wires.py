"""Whether a prepared scenario is the standard loop: feedforward, controller and plant, wired as in the paper."""

from dataclasses import dataclass

from flexbeams.scenarios.definition.declaration import element_names
from flexbeams.scenarios.runs.prepare import PreparedScenario

_KINDS = {"FlatnessFeedforward": "feedforward", "TrackingController": "controller", "BeamPlant": "plant"}
_WIRES = (  # from and to, by role and array
    ("feedforward", "u_ff", "controller", "u_ff"),
    ("feedforward", "x_ref", "controller", "x_ref"),
    ("controller", "u", "plant", "u"),
    ("plant", "y_pm", "controller", "y_pm"),
)


@dataclass(frozen=True, kw_only=True)
class Roles:
    """The instances of a standard loop by their role."""

    feedforward: str
    controller: str
    plant: str


def standard_loop(prepared: PreparedScenario) -> Roles | None:
    """The roles of the instances; None where the loop is another one, or is stepped otherwise."""
    roles = _roles(prepared)
    if roles is None or prepared.wiring.conversions or prepared.scenario.sensor:
        return None
    names = {"feedforward": roles.feedforward, "controller": roles.controller, "plant": roles.plant}
    wires = {}
    for source, output, target, taken in _WIRES:
        outputs = element_names(prepared.declarations[names[source]].variables, output)
        inputs = element_names(prepared.declarations[names[target]].variables, taken)
        if len(outputs) != len(inputs):
            return None
        for one, other in zip(outputs, inputs, strict=True):
            wires[f"{names[target]}.{other}"] = f"{names[source]}.{one}"
    if prepared.wiring.links() != wires:
        return None
    return roles if _is_plain(prepared, roles) else None


def _roles(prepared: PreparedScenario) -> Roles | None:
    found: dict[str, str] = {}
    for name in prepared.scenario.instance:
        role = _KINDS.get(prepared.kinds[name].name, "") if name in prepared.kinds else ""
        if not role or role in found:
            return None
        found[role] = name
    return Roles(**found) if len(found) == len(_KINDS) else None


def _is_plain(prepared: PreparedScenario, roles: Roles) -> bool:
    """Whether it is stepped as the kernel steps, and only targets and forces come from outside."""
    settings, design = prepared.settings, prepared.design
    starts = prepared.starts[roles.controller]
    held = [f"{array}[{k}]" for array in ("u", "force") for k in range(1, len(design.structure.patch) + 1)]
    driven = {
        f"{owner}.{name}"
        for owner, inputs in prepared.wiring.driven().items()
        for name in inputs
        if f"{owner}.{name}" not in prepared.wiring.links()
    }
    allowed = (f"{roles.feedforward}.", f"{roles.plant}.force")
    return (
        settings.backend == "native"
        and settings.decimate == 1
        and prepared.scenario.coupling == "jacobi"
        and prepared.step == design.options.sample_time
        and prepared.start_time == 0.0
        and starts.get("feedback", True) is True
        and all(prepared.starts[roles.plant].get(name, 0.0) == 0.0 for name in held)
        and all(name.startswith(allowed) for name in driven)
    )
