"""Errors of the unit builders."""


class InterfaceError(ValueError):
    """A unit's declared interface breaks a rule of FMI 2.0."""


class BuildError(RuntimeError):
    """A unit could not be built."""
