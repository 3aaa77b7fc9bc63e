"""Quantities: numbers with units, read from text such as `"0.1 km"`."""

import math
import re
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.types import Strict
from pydantic_core import CoreSchema, core_schema

KM_H_PER_M_S = 3.6
M_S_PER_KM_H = 1 / KM_H_PER_M_S

UNITS: dict[str, tuple[str, float]] = {
    "um": ("length", 1e-6),
    "mm": ("length", 1e-3),
    "cm": ("length", 1e-2),
    "m": ("length", 1.0),
    "km": ("length", 1e3),
    "in": ("length", 0.0254),
    "ft": ("length", 0.3048),
    "mi": ("length", 1609.344),
    "m/s": ("speed", 1.0),
    "km/h": ("speed", M_S_PER_KM_H),
    "mph": ("speed", 0.44704),  # exact: the international mile is 1609.344 m
    "mm/h": ("precipitation rate", 1.0),
    "in/h": ("precipitation rate", 25.4),
    "ms": ("time", 1e-3),
    "ns": ("time", 1e-9),
    "s": ("time", 1.0),
    "min": ("time", 60.0),
    "deg": ("angle", 1.0),
    "mrad": ("angle", math.degrees(1e-3)),
    "rad": ("angle", math.degrees(1.0)),
    "lx": ("illuminance", 1.0),
    "klx": ("illuminance", 1e3),
    "cd/m2": ("luminance", 1.0),
    "kcd/m2": ("luminance", 1e3),
    "g/cm3": ("density", 1.0),
    "kg/m3": ("density", 1e-3),
    "degC": ("temperature", 1.0),
    "degF": ("temperature", 5 / 9),
    "mK": ("difference of temperature", 1.0),
    "K": ("difference of temperature", 1e3),
    "Hz": ("frequency", 1e-6),
    "kHz": ("frequency", 1e-3),
    "MHz": ("frequency", 1.0),
    "GHz": ("frequency", 1e3),
    "dB": ("level", 1.0),
    "dBm": ("power", 1.0),
    "kbit/s": ("data rate", 1e-3),
    "Mbit/s": ("data rate", 1.0),
    "Gbit/s": ("data rate", 1e3),
    "B": ("data size", 1.0),
    "kB": ("data size", 1e3),
    "MB": ("data size", 1e6),
    "%": ("fraction", 0.01),
    "1": ("fraction", 1.0),
}
"""Dimension of each unit, and its size in the dimension's unit of size 1."""
ZEROES = {"degF": 32.0}
"""Readings at the zero of the dimension's unit of size 1, for units with another zero."""
_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_QUANTITY = re.compile(rf"^\s*({_NUMBER}|inf)\s*(\S.*?)?\s*$")


@dataclass(frozen=True)
class Unit:
    """The unit of a field, into which text such as `"0.1 km"` is converted."""

    name: str

    @property
    def dimension(self) -> str:
        """Physical dimension, such as `length` or `speed`."""
        return UNITS[self.name][0]

    @property
    def compatible_units(self) -> tuple[str, ...]:
        """Units of the same dimension, which an author may write."""
        return tuple(
            name for name, (dimension, _) in UNITS.items()
            if dimension == self.dimension and name != "1"
        )  # fmt: skip

    @property
    def example(self) -> str:
        """Example of a quantity, for hints."""
        return "50 %" if self.dimension == "fraction" else f"10 {self.name}"

    def parse(self, value: Any) -> Any:
        """Convert text to a number in this unit; return any other value unchanged.

        Raises:
            ValueError: The text holds no number, or a unit of another dimension.
        """
        if not isinstance(value, str):
            return value
        match = _QUANTITY.match(value)
        if re.search(r"\d,\d", value):
            raise ValueError(f"'{value}' has a comma; write a point, as in 2.5 {self.name}")
        if match is None:
            article = "an" if self.dimension[0] in "aeiou" else "a"
            what = f"{article} {self.dimension}"
            raise ValueError(f"'{value}' is not {what}; write e.g. {self.example}")
        number, written = match.groups()
        if written is None:
            raise ValueError(f"'{value}' is text; remove the quotes, or add a unit: {self.example}")
        # "1" is the unit of plain fractions in the schema; "0.5 1" is not valid input.
        dimension, size = UNITS.get(written, ("", 1.0)) if written != "1" else ("", 1.0)
        if dimension != self.dimension:
            what = f"is a unit of {dimension}" if dimension else "is not a known unit"
            valid = ", ".join(self.compatible_units)
            raise ValueError(f"'{written}' {what}; units of {self.dimension}: {valid}")
        result = (float(number) - ZEROES.get(written, 0.0)) * size / UNITS[self.name][1]
        if math.isinf(result) and number != "inf":
            raise ValueError(f"'{value}' is too large for a number")
        # Rounding hides the factor's representation error: "0.1 km" is 100 m exactly.
        return round(result, 12)

    # Before the inner validator, which is strict and would reject text.
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


@dataclass(frozen=True)
class RangeReason:
    """Reason for a field's range; the hint when a value lies outside it.

    Attributes:
        text: The reason.
        upper: Upper bound explained by it; narrower bounds of fields have no explanation here.
    """

    text: str
    upper: float | None = None


_Number = Annotated[float, Strict()]
Number = Annotated[_Number, Field(ge=-1e9, le=1e9)]
"""A number without a unit; neither text nor a boolean is accepted."""
Count = Annotated[int, Strict(), Field(ge=0, le=2**32 - 1)]
Flag = Annotated[bool, Strict()]
"""`true` or `false`, nothing else."""

# Physical bounds of each quantity; fields narrow them further.
Metres = Annotated[
    _Number,
    Unit("m"),
    Field(ge=-1e7, le=1e7),
    RangeReason("coordinates of maps are at most 10,000 km from their origin", 1e7),
]
Millimetres = Annotated[_Number, Unit("mm"), Field(ge=-1e6, le=1e6)]
Micrometres = Annotated[_Number, Unit("um"), Field(ge=-1e6, le=1e6)]
MetresPerSecond = Annotated[
    _Number,
    Unit("m/s"),
    Field(ge=-150, le=150),
    RangeReason("150 m/s is faster than anything on a road", 150),
]
KilometresPerHour = Annotated[
    _Number,
    Unit("km/h"),
    Field(ge=-500, le=500),
    RangeReason("500 km/h is faster than anything on a road", 500),
]
MillimetresPerHour = Annotated[
    _Number,
    Unit("mm/h"),
    Field(ge=0, le=2500),
    RangeReason("no rain above 2,300 mm/h was ever recorded", 2500),
]
Seconds = Annotated[
    _Number,
    Unit("s"),
    Field(ge=-1e6, le=1e6),
    RangeReason("a million seconds are eleven days", 1e6),
]
Milliseconds = Annotated[_Number, Unit("ms"), Field(ge=-1e9, le=1e9)]
Nanoseconds = Annotated[_Number, Unit("ns"), Field(ge=-1e9, le=1e9)]
Milliradians = Annotated[_Number, Unit("mrad"), Field(ge=-7000, le=7000)]
Degrees = Annotated[
    _Number, Unit("deg"), Field(ge=-720, le=720), RangeReason("720 deg are two full turns", 720)
]
Lux = Annotated[
    _Number,
    Unit("lx"),
    Field(ge=0, le=200_000),
    RangeReason("sunlight above the atmosphere is 134,000 lx", 200_000),
]
GramsPerCubicCentimetre = Annotated[_Number, Unit("g/cm3"), Field(ge=0, le=25)]
Celsius = Annotated[
    _Number,
    Unit("degC"),
    Field(ge=-100, le=100),
    RangeReason("no weather is colder or hotter", 100),
]
Millikelvins = Annotated[_Number, Unit("mK"), Field(ge=0, le=1e6)]
Hertz = Annotated[_Number, Unit("Hz"), Field(ge=0, le=1e12)]
Megahertz = Annotated[_Number, Unit("MHz"), Field(ge=0, le=1e6)]
Decibels = Annotated[_Number, Unit("dB"), Field(ge=-200, le=200)]
DecibelMilliwatts = Annotated[_Number, Unit("dBm"), Field(ge=-200, le=200)]
MegabitsPerSecond = Annotated[
    _Number,
    Unit("Mbit/s"),
    Field(ge=0, le=1e6),
    RangeReason("a million Mbit/s are beyond any radio", 1e6),
]
Bytes = Annotated[_Number, Unit("B"), Field(ge=0, le=1e12)]
Fraction = Annotated[_Number, Unit("1"), Field(ge=0, le=1)]
Percent = Annotated[_Number, Unit("%"), Field(ge=0, le=100)]

PositiveMetres = Annotated[
    Metres, Field(ge=0.001, le=100_000), RangeReason("lengths are 1 mm to 100 km", 100_000)
]
Point2 = tuple[Metres, Metres]
"""x east, y north, in metres."""
Point3 = tuple[Metres, Metres, Metres]
"""x east, y north, z up, in metres."""
