"""What every model shares: frozen, closed to unknown keys, ids and quantities with units.

Hints that name what somebody may have meant.
"""

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    SerializerFunctionWrapHandler,
    model_serializer,
)
from pydantic.types import Strict, StringConstraints
from pydantic_core import CoreSchema, core_schema

Id = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
"""A stable lower-case name; safe as a file name."""
Digest = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
"""A SHA-256."""


class Model(BaseModel):
    """Frozen record; an unknown key is an error, and so is a number without end."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


UNITS: dict[str, tuple[str, float]] = {
    "um": ("length", 1e-6),
    "mm": ("length", 1e-3),
    "cm": ("length", 1e-2),
    "m": ("length", 1.0),
    "km": ("length", 1e3),
    "m/s": ("speed", 1.0),
    "km/h": ("speed", 1 / 3.6),
    "mph": ("speed", 0.44704),
    "mm/h": ("precipitation rate", 1.0),
    "s": ("time", 1.0),
    "min": ("time", 60.0),
    "deg": ("angle", 1.0),
    "rad": ("angle", 57.29577951308232),
    "lx": ("illuminance", 1.0),
    "klx": ("illuminance", 1e3),
    "cd/m2": ("luminance", 1.0),
    "kcd/m2": ("luminance", 1e3),
    "g/cm3": ("density", 1.0),
    "kg/m3": ("density", 1e-3),
    "degC": ("temperature", 1.0),
    "%": ("share", 0.01),
    "1": ("share", 1.0),
}
"""Dimension of every unit, and its size in the dimension's first unit of size 1."""
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_QUANTITY = re.compile(rf"^\s*({_NUMBER}|inf)\s*(\S.*?)?\s*$")


@dataclass(frozen=True)
class Unit:
    """The unit of a field: reads text such as `"0.1 km"` into numbers of `name`."""

    name: str

    @property
    def dimension(self) -> str:
        """`length`, `speed`, ..."""
        return UNITS[self.name][0]

    @property
    def compatible_units(self) -> tuple[str, ...]:
        """Units that may be written: those of the same dimension."""
        return tuple(
            name for name, (dimension, _) in UNITS.items()
            if dimension == self.dimension and name != "1"
        )  # fmt: skip

    @property
    def example(self) -> str:
        """How a quantity of this unit may be written."""
        return "50 %" if self.dimension == "share" else f"10 {self.name}"

    def parse(self, value: Any) -> Any:
        """A number of this unit from text; whatever is not text as it is.

        Raises:
            ValueError: The text holds no number, or a unit of another dimension.
        """
        if not isinstance(value, str):
            return value
        match = _QUANTITY.match(value)
        if re.search(r"\d,\d", value):
            raise ValueError(f"'{value}' has a comma; write a point, as in 2.5 {self.name}")
        if match is None:
            raise ValueError(f"'{value}' is no {self.dimension}; write e.g. {self.example}")
        number, written = match.groups()
        if written is None:
            raise ValueError(
                f"'{value}' is text; take the quotes away, or add a unit: {self.example}"
            )
        found = UNITS.get(written) if written != "1" else None
        if found is None or found[0] != self.dimension:
            what = f"a unit of {found[0]}" if found else "no unit known here"
            fitting = ", ".join(self.compatible_units)
            raise ValueError(f"'{written}' is {what}; a {self.dimension} has one of {fitting}")
        return round(float(number) * found[1] / UNITS[self.name][1], 12)

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self.parse, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        units = "|".join(re.escape(name) for name in self.compatible_units)
        text = {"type": "string", "pattern": rf"^\s*({_NUMBER}|inf)\s*({units})\s*$"}
        return {"anyOf": [handler(schema), text], "unit": self.name, "examples": [self.example]}


class InvalidCombination(ValueError):
    """Values that are fine alone and do not go together.

    Attributes:
        value_path: Path of the value to change, from the model that found it.
        message: What is wrong.
        hint: The way out.
        other_path: Path of the other value, to be shown where the first is a default.
    """

    def __init__(
        self,
        value_path: tuple[str | int, ...],
        message: str,
        hint: str,
        *,
        other_path: tuple[str | int, ...] = (),
    ) -> None:
        super().__init__(f"{'.'.join(map(str, value_path))}: {message}; {hint}")
        self.value_path = value_path
        self.message = message
        self.hint = hint
        self.other_path = other_path


@dataclass(frozen=True)
class RangeReason:
    """Why a field's range is what it is; told to those who leave it."""

    text: str


Number = Annotated[float, Strict()]
"""A number without a unit; neither text nor a truth value is one."""
Count = Annotated[int, Strict()]
Flag = Annotated[bool, Strict()]
"""`true` or `false`, nothing else."""

Metres = Annotated[Number, Unit("m")]
Millimetres = Annotated[Number, Unit("mm")]
Micrometres = Annotated[Number, Unit("um")]
MetresPerSecond = Annotated[Number, Unit("m/s")]
KilometresPerHour = Annotated[Number, Unit("km/h")]
MillimetresPerHour = Annotated[Number, Unit("mm/h")]
Seconds = Annotated[Number, Unit("s")]
Degrees = Annotated[Number, Unit("deg")]
Lux = Annotated[Number, Unit("lx")]
GramsPerCubicCentimetre = Annotated[Number, Unit("g/cm3")]
Celsius = Annotated[Number, Unit("degC")]
Fraction = Annotated[Number, Unit("1"), Field(ge=0, le=1)]
Percent = Annotated[Number, Unit("%"), Field(ge=0, le=100)]

PositiveMetres = Annotated[Metres, Field(gt=0)]
Point2 = tuple[Metres, Metres]
"""x east, y north, in metres."""
Point3 = tuple[Metres, Metres, Metres]
"""x east, y north, z up, in metres."""


class Declaration(Model):
    """What every YAML document has besides its `kind`."""

    id: Id
    """Its name, by which others refer to it; part of the ids of scenarios."""
    title: str = ""
    """What it is, in a few words."""
    source: str = ""
    """Where the figures come from."""
    assumption: str = ""
    """Which figures nobody measured, and why they are what they are."""


def is_none(value: object) -> bool:
    """For `exclude_if`: a field that says nothing is left out of a spec's JSON."""
    return value is None


def is_empty(value: object) -> bool:
    """The same for what is none, zero, or holds nothing."""
    return not value


class CompactModel(Model):
    """A record that a spec holds dozens of: what goes without saying is left out of its JSON."""

    @model_serializer(mode="wrap")
    def _serialize_without_defaults(
        self, serialise: SerializerFunctionWrapHandler
    ) -> dict[str, Any]:
        defaults = _get_field_defaults(type(self))
        return {
            name: value
            for name, value in serialise(self).items()
            if name not in defaults or getattr(self, name) != defaults[name]
        }


@cache
def _get_field_defaults(model: type[Model]) -> dict[str, Any]:
    """What goes without saying, by field."""
    fields = model.model_fields.items()
    return {
        name: field.get_default(call_default_factory=True)
        for name, field in fields
        if not field.is_required()
    }


MAX_LISTED_NAMES = 20


def suggest_name(name: str, valid: Iterable[str]) -> str:
    """A hint that names the nearest valid name, else all of them."""
    names = sorted(valid)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    if close:
        return f"did you mean '{close[0]}'?"
    more = ", ..." if len(names) > MAX_LISTED_NAMES else ""
    return f"there are: {', '.join(names[:MAX_LISTED_NAMES])}{more}" if names else "there are none"
