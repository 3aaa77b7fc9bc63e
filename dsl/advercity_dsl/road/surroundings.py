"""Surroundings of streets: buildings, vegetation, street furniture, parked cars."""

from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import CompactModel, Id, InvalidCombination, Items, Model, is_empty, is_none
from advercity_dsl.units import (
    Count,
    KilometresPerHour,
    Metres,
    Number,
    Point2,
    PositiveMetres,
    RangeReason,
)


class SurroundingKind(StrEnum):
    """Kind of object in the surroundings of a road."""

    BUILDINGS = "buildings"
    HOUSES = "houses"
    TREES = "trees"
    HEDGE = "hedge"
    CROPS = "crops"
    FIELD = "field"
    WALL = "wall"
    FENCE = "fence"
    BUS_STOP = "bus_stop"
    TOWER = "tower"
    POLE = "pole"
    LAMP = "lamp"
    PLATEAU = "plateau"
    WOODS = "woods"
    WATER = "water"
    PARKED_CARS = "parked_cars"
    SPEED_SIGN = "speed_sign"
    DRIVEWAY = "driveway"
    PAVING = "paving"
    FURNITURE = "furniture"
    GUARD_RAIL = "guard_rail"
    BOLLARDS = "bollards"
    POWER_LINE = "power_line"
    SIGN = "sign"
    SKYLINE = "skyline"


class SignKind(StrEnum):
    """Traffic sign of the Vienna convention."""

    PEDESTRIAN_CROSSING = "pedestrian_crossing"
    PRIORITY_ROAD = "priority_road"
    CURVE_LEFT = "curve_left"
    CURVE_RIGHT = "curve_right"


# The name of this class is part of random stream keys: renaming it changes every tree.
class Species(StrEnum):
    """Species of tree."""

    OAK = "oak"
    MAPLE = "maple"
    BIRCH = "birch"
    POPLAR = "poplar"
    SPRUCE = "spruce"


class Season(StrEnum):
    """Season of the plants."""

    SUMMER = "summer"
    AUTUMN = "autumn"
    WINTER = "winter"


RoadsideOffset = Annotated[
    Metres, Field(ge=-1000, le=1000), RangeReason("1 km from a road nothing is visible")
]


class RoadsidePlacement(CompactModel):
    """A place along a street, given in the street's own coordinates."""

    street: Id
    """Street along which it extends."""
    side: Literal["left", "right", "both"]
    """Side of the street, seen along its axis."""
    from_m: Annotated[Metres, Field(ge=0, le=100_000)] = 0
    """Distance along the axis at which it begins."""
    to_m: Annotated[Metres | None, Field(gt=0, le=100_000)] = None
    """Distance along the axis at which it ends; by default the end of the street."""
    offset_m: RoadsideOffset | tuple[RoadsideOffset, RoadsideOffset] = 1
    """Distance outwards from the edge of the paving: of a line, or of both borders of a band."""

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if self.to_m is not None and self.to_m <= self.from_m:
            raise ValueError("'to_m' must be greater than 'from_m'")
        if isinstance(self.offset_m, tuple) and self.offset_m[1] <= self.offset_m[0]:
            raise ValueError("'offset_m' must give the nearer border of a band first")
        return self

    @property
    def band_m(self) -> tuple[float, float]:
        """Offsets of the nearer and the farther border; equal for a line."""
        if isinstance(self.offset_m, tuple):
            return self.offset_m
        return self.offset_m, self.offset_m


Density = Annotated[Number, Field(ge=0, le=50)]


class FurnitureDensity(CompactModel):
    """Pieces of street furniture in 100 m of one side of a street.

    They are behind the sidewalk, all of which people walk on, at random distances. Where there is
    no room for them, as between a sidewalk and a wall, there are fewer.
    """

    bench: Density = 0
    """Benches with a back, towards the street."""
    bin: Density = 0
    """Litter bins on a post."""
    post_box: Density = 0
    """Letter boxes."""
    hydrant: Density = 0
    """Pillar hydrants."""
    cabinet: Density = 0
    """Cabinets of telephone and power networks."""
    bicycle_stand: Density = 0
    """Stands for bicycles, five hoops each; bicycles are at three in five of them."""
    planter: Density = 0
    """Tubs with a shrub."""
    hoarding: Density = 0
    """Boards with advertisements, 2.7 m wide, on two posts."""
    works: Density = 0
    """Works in the ground, 5 m long, between barriers and cones."""


MAX_AREA_M2 = 1e6
MAX_OBJECTS = 50_000
_BESIDE, _AREA, _LINE, _AT = "beside", "area_m", "line_m", "at_m"
_ALLOWED_PLACEMENTS = {
    SurroundingKind.BUILDINGS: (_BESIDE, _AREA, _LINE),
    SurroundingKind.HOUSES: (_BESIDE, _AREA),
    SurroundingKind.TREES: (_BESIDE, _AREA, _LINE, _AT),
    SurroundingKind.HEDGE: (_BESIDE, _LINE),
    SurroundingKind.CROPS: (_BESIDE, _AREA, _LINE),
    SurroundingKind.FIELD: (_BESIDE, _AREA, _LINE),
    SurroundingKind.WALL: (_BESIDE, _LINE),
    SurroundingKind.FENCE: (_BESIDE, _LINE),
    SurroundingKind.BUS_STOP: (_AT,),
    SurroundingKind.TOWER: (_AT,),
    SurroundingKind.POLE: (_BESIDE, _LINE, _AT),
    SurroundingKind.LAMP: (_BESIDE, _LINE, _AT),
    SurroundingKind.PLATEAU: (_LINE,),
    SurroundingKind.WOODS: (_BESIDE, _AREA, _LINE),
    SurroundingKind.WATER: (_LINE,),
    SurroundingKind.PARKED_CARS: (_BESIDE,),
    SurroundingKind.SPEED_SIGN: (_BESIDE,),
    SurroundingKind.DRIVEWAY: (_BESIDE,),
    SurroundingKind.PAVING: (_BESIDE,),
    SurroundingKind.FURNITURE: (_BESIDE,),
    SurroundingKind.GUARD_RAIL: (_BESIDE, _LINE),
    SurroundingKind.BOLLARDS: (_BESIDE, _LINE),
    SurroundingKind.POWER_LINE: (_BESIDE, _LINE),
    SurroundingKind.SIGN: (_BESIDE,),
    SurroundingKind.SKYLINE: (_AREA,),
}
_BAND_KINDS = (
    SurroundingKind.CROPS,
    SurroundingKind.FIELD,
    SurroundingKind.WOODS,
    SurroundingKind.DRIVEWAY,
    SurroundingKind.PAVING,
)
_OUTLINED_KINDS = (
    SurroundingKind.BUILDINGS,
    SurroundingKind.CROPS,
    SurroundingKind.FIELD,
    SurroundingKind.WOODS,
    SurroundingKind.WATER,
    SurroundingKind.PLATEAU,
)
"""Kinds whose `line_m` is an outline."""
LampType = Literal["arm", "lantern", "wooden_pole", "column"]
Roof = Literal["flat", "gabled", "hipped"]
BuildingUse = Literal["residential", "commercial", "industrial"]


class Surrounding(Model):
    """Objects of one kind along a street, in an area, along a line, or at points.

    For buildings, fields, woods and water the line is an outline; outlined buildings are one
    building. A plateau is ground raised by `height_m` within its outline `line_m`; it meets the
    streets up to it and drops steeply elsewhere. Parked cars occupy the parking strip of their
    street. A speed sign, as any sign, is at `from_m` and faces the traffic on its side. A driveway
    is a paved band across the sidewalk; paving is slabs from the sidewalk to the buildings. A
    skyline is a town in the distance.
    """

    kind: SurroundingKind
    """Kind of objects."""
    beside: RoadsidePlacement | None = Field(default=None, exclude_if=is_empty)
    """Place along a street."""
    area_m: tuple[Point2, Point2] | None = Field(default=None, exclude_if=is_empty)
    """Two opposite corners of a rectangular area."""
    line_m: Items[Point2] = Field(default=(), exclude_if=is_empty)
    """Line along which they are placed, or outline; points [east, north]."""
    at_m: Items[Point2] = Field(default=(), exclude_if=is_empty)
    """Single points, [east, north]."""
    height_m: Annotated[PositiveMetres, Field(ge=0.05, le=1000)] | None = Field(
        default=None, exclude_if=is_empty
    )
    """Height of each object."""
    spacing_m: Annotated[PositiveMetres, Field(ge=1)] | None = Field(
        default=None, exclude_if=is_empty
    )
    """Spacing of trees, lamps, poles, buildings, or parking spaces."""
    species: Items[Species] = Field(default=(), exclude_if=is_empty)
    """Species of trees; all if none is given."""
    roof: Roof | None = Field(default=None, exclude_if=is_none)
    """Roof of a building with an outline; by default as usual for its size."""
    use: BuildingUse | None = Field(default=None, exclude_if=is_none)
    """Use of a building with an outline, which gives it shops, or the walls of a hall; by default
    as usual for its size."""
    limit_km_h: Annotated[KilometresPerHour, Field(ge=1, le=200)] | None = Field(
        default=None, exclude_if=is_none
    )
    """Limit on a speed sign; by default its street's limit."""
    sign: SignKind | None = Field(default=None, exclude_if=is_none)
    """Which sign."""
    per_100_m: FurnitureDensity | None = Field(default=None, exclude_if=is_none)
    """How much street furniture."""
    lamp: LampType | None = Field(default=None, exclude_if=is_none)
    """Type of street lamps: a curved arm on a mast, a lantern on a post, a dish on a wooden pole,
    or a high column. By default columns where the limit is 80 km/h or more, wooden poles in the
    country and arms in towns."""
    seed: Count = Field(default=0, exclude_if=is_empty)
    """Seed of the random shapes of trees and buildings."""

    @model_validator(mode="after")
    def _check_placement(self) -> Self:
        given = [name for name in (_BESIDE, _AREA, _LINE, _AT) if getattr(self, name)]
        allowed = _ALLOWED_PLACEMENTS[self.kind]
        if not given or any(name not in allowed for name in given):
            given_text = f"has {' and '.join(given)}" if given else "has no place"
            options = " or ".join(f"'{name}'" for name in allowed)
            raise ValueError(f"{self.kind} {given_text}; give it {options}")
        if self.kind in _BAND_KINDS and self.beside and not isinstance(self.beside.offset_m, tuple):
            raise ValueError(f"{self.kind} along a street need two offsets, as in [2, 60]")
        if self.kind in _OUTLINED_KINDS and 0 < len(self.line_m) < 3:
            raise ValueError(f"an outline of {self.kind} has three points or more in 'line_m'")
        if self.kind is SurroundingKind.PLATEAU and not self.height_m:
            raise ValueError("a plateau has a 'height_m'")
        is_outlined = self.kind is SurroundingKind.BUILDINGS and bool(self.line_m)
        for name in ("roof", "use"):
            if getattr(self, name) and not is_outlined:
                raise ValueError(f"only a building with an outline 'line_m' has a '{name}'")
        if (self.kind is SurroundingKind.SIGN) != (self.sign is not None):
            raise ValueError("a sign has a 'sign', other kinds have none")
        if (self.kind is SurroundingKind.FURNITURE) != (self.per_100_m is not None):
            raise ValueError("furniture has 'per_100_m', other kinds have none")
        self._check_area()
        if self.lamp and self.kind is not SurroundingKind.LAMP:
            raise ValueError("only lamps have a type 'lamp'")
        if self.species and self.kind is not SurroundingKind.TREES:
            raise ValueError("only trees have 'species'")
        if self.limit_km_h and self.kind is not SurroundingKind.SPEED_SIGN:
            raise ValueError("only a speed sign has a 'limit_km_h'")
        return self

    def _check_area(self) -> None:
        if self.area_m is None:
            return
        (west, south), (east, north) = self.area_m
        square_metres = abs(east - west) * abs(north - south)
        if square_metres > MAX_AREA_M2:
            message = f"has {square_metres / 1e6:.6g} km2"
            raise InvalidCombination(
                ("area_m",), message, f"the limit is {MAX_AREA_M2 / 1e6:g} km2; give several"
            )
        count = square_metres / (self.spacing_m or 10.0) ** 2
        if count > MAX_OBJECTS:
            message = f"has room for {count:.0f} objects"
            raise InvalidCombination(("spacing_m",), message, f"the limit is {MAX_OBJECTS}")
