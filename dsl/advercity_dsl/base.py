"""What every model shares: frozen, closed to unknown keys, ids and quantities with units."""

import re
from collections.abc import Callable
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, StringConstraints

Id = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
"""A stable lower-case name; safe as a file name."""


class Model(BaseModel):
    """Frozen record; an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


_UNITS: dict[str, tuple[str, float]] = {
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
_WRITTEN = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|inf)\s*(\S+)\s*$")


def in_unit(unit: str) -> Callable[[Any], Any]:
    """A validator that turns text such as `"0.1 km"` into a number of `unit`."""
    dimension, factor = _UNITS[unit]
    fitting = [name for name, (other, _) in _UNITS.items() if other == dimension and name != "1"]

    def convert(value: Any) -> Any:
        if not isinstance(value, str):
            return value
        match = _WRITTEN.match(value)
        if match is None:
            raise ValueError(f"not a {dimension}; write a number or e.g. '{_example(unit)}'")
        number, written = match.groups()
        found = _UNITS.get(written)
        if found is None or found[0] != dimension:
            what = f"a unit of {found[0]}" if found else "no unit known here"
            raise ValueError(f"'{written}' is {what}; a {dimension} in {', '.join(fitting)} fits")
        return round(float(number) * found[1] / factor, 12)

    return convert


def _example(unit: str) -> str:
    return "0.5" if unit == "1" else f"10 {unit}"


Metres = Annotated[float, BeforeValidator(in_unit("m"))]
Millimetres = Annotated[float, BeforeValidator(in_unit("mm"))]
Micrometres = Annotated[float, BeforeValidator(in_unit("um"))]
MetresPerSecond = Annotated[float, BeforeValidator(in_unit("m/s"))]
KilometresPerHour = Annotated[float, BeforeValidator(in_unit("km/h"))]
MillimetresPerHour = Annotated[float, BeforeValidator(in_unit("mm/h"))]
Seconds = Annotated[float, BeforeValidator(in_unit("s"))]
Degrees = Annotated[float, BeforeValidator(in_unit("deg"))]
Lux = Annotated[float, BeforeValidator(in_unit("lx"))]
CandelasPerSquareMetre = Annotated[float, BeforeValidator(in_unit("cd/m2"))]
GramsPerCubicCentimetre = Annotated[float, BeforeValidator(in_unit("g/cm3"))]
Celsius = Annotated[float, BeforeValidator(in_unit("degC"))]
Share = Annotated[float, BeforeValidator(in_unit("1")), Field(ge=0, le=1)]
Percent = Annotated[float, Field(ge=0, le=100)]

PositiveMetres = Annotated[Metres, Field(gt=0)]
Point2 = tuple[Metres, Metres]
"""x east, y north, in metres."""
Point3 = tuple[Metres, Metres, Metres]
"""x east, y north, z up, in metres."""


class Declaration(Model):
    """What every YAML document has besides its `kind`."""

    id: Id
    title: str = ""
    source: str = ""
    """Where the figures come from."""
