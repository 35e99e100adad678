"""The structure file: beams, patch pairs, springs, points of interest and strain gauges.

Bounds and units of the physical parameters are those of `plant.parameters`.
"""

from dataclasses import replace
from itertools import pairwise
from os.path import isfile
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError
from pydantic.dataclasses import dataclass

from flexbeams.plant.actuator.parameters import Actuator
from flexbeams.plant.errors import InputError, missing_file_hint, suggestion
from flexbeams.plant.parameters import PARAMETERS, parameter, parameters_of, within_bounds
from flexbeams.plant.text import quoted
from flexbeams.plant.validation import STRICT, Index, NonNegative, Positive, read_toml, validate

STRUCTURES_FOLDER = Path(__file__).parent / "structures"
PARTS = tuple(dict.fromkeys(entry.part for entry in PARAMETERS))  # with physical parameters
_ROUNDING = 1e-12  # relative; parts that touch in decimal numbers may overlap by a rounding error


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Beam:
    """A clamped-free Euler-Bernoulli beam with a tip mass."""

    length: Positive  # m
    width: Positive  # m
    thickness: Positive  # m
    density: Annotated[float, within_bounds("beam", "density")]
    youngs_modulus: Annotated[float, within_bounds("beam", "youngs_modulus")]
    tip_mass: Annotated[float, within_bounds("beam", "tip_mass")]
    viscous_damping: Annotated[float, within_bounds("beam", "viscous_damping")]
    structural_damping: Annotated[float, within_bounds("beam", "structural_damping")]

    @property
    def area(self) -> float:
        """Cross section, m^2."""
        return self.width * self.thickness

    @property
    def second_moment(self) -> float:
        """Area moment of inertia w h^3 / 12, m^4."""
        return self.width * self.thickness**3 / 12


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Patch:
    """A pair of piezoelectric patches, one on the front and one on the back of a beam."""

    beam: Index  # which beam, counted from 1
    position: NonNegative  # start of the pair from the clamp, m
    length: Positive  # m
    width: Positive  # m
    thickness: Positive  # m
    density: Annotated[float, within_bounds("patch", "density")]
    youngs_modulus: Annotated[float, within_bounds("patch", "youngs_modulus")]
    viscous_damping: Annotated[float, within_bounds("patch", "viscous_damping")]
    structural_damping: Annotated[float, within_bounds("patch", "structural_damping")]
    piezo_ratio: Annotated[float, within_bounds("patch", "piezo_ratio")]
    electrode_distance: Positive  # e_s, m

    @property
    def end(self) -> float:
        """End of the pair from the clamp, m."""
        return self.position + self.length

    @property
    def area(self) -> float:
        """Cross section of one patch, m^2."""
        return self.width * self.thickness

    def second_moment(self, beam: Beam) -> float:
        """Area moment of one patch about the beam's neutral axis, m^4.

        (w_a/3) [(h/2 + h_a)^3 - (h/2)^3]; the formula printed under (9) lacks the factor 1/3.
        """
        inner = beam.thickness / 2
        return self.width / 3 * ((inner + self.thickness) ** 3 - inner**3)

    def moment_per_volt(self, beam: Beam) -> float:
        """Gamma of (9), N m/V: A_a (h + h_a) piezo_ratio / (2 e_s)."""
        return self.area * (beam.thickness + self.thickness) * self.piezo_ratio / (2 * self.electrode_distance)


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Spring:
    """A spring between the tips of two beams."""

    between: tuple[Index, Index]  # beams, counted from 1
    stiffness: Annotated[float, within_bounds("spring", "stiffness")]


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class PointOfInterest:
    """Where a deflection y_pi is controlled."""

    beam: Index  # counted from 1
    position: Positive  # m from the clamp


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class StrainGauge:
    """Where a strain y_pm is measured: the mean over [position - length/2, position + length/2]."""

    beam: Index  # counted from 1
    position: Positive  # centre, m from the clamp
    length: NonNegative  # m; 0: strain at the point


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Structure:
    """A whole structure; lists are in the order of the file.

    Raises InputError (inside pydantic's ValidationError when built by hand) where parts contradict each other.
    """

    beam: list[Beam] = Field(min_length=1)
    patch: list[Patch] = Field(min_length=1)
    spring: list[Spring] = Field(default_factory=list)
    point_of_interest: list[PointOfInterest] = Field(min_length=1)
    strain_gauge: list[StrainGauge] = Field(min_length=1)
    actuator: Actuator | None = None  # no part of a design: only MfcActuator and MfcCompensator read it

    def __post_init__(self) -> None:
        self._check_positions()
        self._check_overlaps()
        self._check_springs()
        if self.actuator is not None and len(self.actuator.pair) != len(self.patch):
            rule = f"must have an entry for each patch pair, {len(self.patch)}"
            raise InputError("actuator.pair", rule, len(self.actuator.pair))

    def _beam_of(self, key: str, number: int) -> Beam:
        if number > len(self.beam):
            raise InputError(f"{key}.beam", f"must be a beam from 1 to {len(self.beam)}", number)
        return self.beam[number - 1]

    def _check_positions(self) -> None:
        for k, patch in enumerate(self.patch, 1):
            beam = self._beam_of(f"patch[{k}]", patch.beam)
            if patch.end > beam.length * (1 + _ROUNDING):
                raise InputError(
                    f"patch[{k}].position",
                    f"plus length must not pass the end of beam {patch.beam} ({beam.length} m)",
                    round(patch.end, 12),
                )
            if patch.width > beam.width:
                raise InputError(
                    f"patch[{k}].width", f"must not exceed the width of beam {patch.beam} ({beam.width} m)", patch.width
                )
        for k, point in enumerate(self.point_of_interest, 1):
            beam = self._beam_of(f"point_of_interest[{k}]", point.beam)
            if point.position > beam.length:
                raise InputError(
                    f"point_of_interest[{k}].position",
                    f"must lie on beam {point.beam} (0 ... {beam.length} m)",
                    point.position,
                )
        for k, gauge in enumerate(self.strain_gauge, 1):
            beam = self._beam_of(f"strain_gauge[{k}]", gauge.beam)
            half = gauge.length / 2
            slack = _ROUNDING * beam.length
            if gauge.position - half < -slack or gauge.position + half > beam.length + slack:
                raise InputError(
                    f"strain_gauge[{k}].position",
                    f"with its length {gauge.length} m must lie on beam {gauge.beam} (0 ... {beam.length} m)",
                    gauge.position,
                )

    def _check_overlaps(self) -> None:
        for j in range(1, len(self.beam) + 1):
            placed = sorted((p.position, p.end, k) for k, p in enumerate(self.patch, 1) if p.beam == j)
            for (_, end, first), (start, _, second) in pairwise(placed):
                if start < end * (1 - _ROUNDING):  # 0.02 + 0.085 > 0.105 in doubles
                    raise InputError(
                        f"patch[{second}].position",
                        f"must not overlap patch[{first}], which ends at {end:.6g} m",
                        start,
                    )

    def _check_springs(self) -> None:
        seen: set[tuple[int, int]] = set()
        for k, spring in enumerate(self.spring, 1):
            i, j = sorted(spring.between)
            if j > len(self.beam) or j - i != 1:
                raise InputError(
                    f"spring[{k}].between",
                    f"must be two adjacent beams from 1 to {len(self.beam)}",
                    list(spring.between),
                )
            if (i, j) in seen:
                raise InputError(f"spring[{k}].between", "must not repeat an earlier spring", list(spring.between))
            seen.add((i, j))

    def parameters(self) -> dict[str, float]:
        """The physical parameters by name: 5 for each beam and each patch pair, 1 for each spring.

        The paper's structure has 3 x 5 + 4 x 5 + 2 = 37. Names as in the units: beam[1].density,
        patch[4].piezo_ratio, spring[2].stiffness.
        """
        return {
            entry.of(k): float(getattr(item, entry.name))
            for part in PARTS
            for k, item in enumerate(getattr(self, part), 1)
            for entry in parameters_of(part)
        }

    def with_parameters(self, values: dict[str, float]) -> "Structure":
        """A copy with the named parameters changed; InputError for an unknown name or a bad value."""
        current = self.parameters()
        parts: dict[str, Any] = {part: list(getattr(self, part)) for part in PARTS}
        for key, value in values.items():
            if key not in current:
                raise InputError(key, "is not a parameter" + suggestion(key, current))
            part, rest = key.split("[")
            number, name = rest.split("].")
            try:
                parts[part][int(number) - 1] = replace(parts[part][int(number) - 1], **{name: float(value)})
            except ValidationError:
                raise InputError(key, parameter(part, name).rule, value) from None
        return replace(self, **parts)


def read_structure(path: Path | str) -> Structure:
    """The structure in a TOML file; InputError with one line that names file, key, rule and value."""
    return validate(Structure, read_toml(Path(path)), str(path))


def find_structure(name: str, relative_to: Path | None = None) -> Path:
    """The path of a structure given as a file (also relative to the folder `relative_to`) or as a shipped name."""
    candidates = [Path(name), *([relative_to / name] if relative_to else []), STRUCTURES_FOLDER / f"{name}.toml"]
    for path in candidates:
        if isfile(path):  # False also for names that no file can have
            return path
    shipped = sorted(p.stem for p in STRUCTURES_FOLDER.glob("*.toml"))
    hint = missing_file_hint(name, relative_to) or suggestion(name, shipped)
    raise InputError("structure", f"{quoted(name)} is neither a file nor a shipped structure{hint}")
