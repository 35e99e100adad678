"""Errors of describing and building units."""

from flexbeams.plant.errors import FlexbeamsError


class InterfaceError(FlexbeamsError):
    """A unit's declared interface breaks a rule of FMI 2.0."""


class BuildError(FlexbeamsError):
    """A unit could not be built."""
