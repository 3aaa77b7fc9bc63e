"""A road as the rest of the world needs it, whether it was authored or imported."""

from dataclasses import dataclass
from typing import Literal, Protocol

from advercity_dsl.base import Point2, Point3
from shapely.geometry.base import BaseGeometry

from advercity.curves import Points
from advercity.world.scene import Lane, Mesh


@dataclass(frozen=True)
class Head:
    """A traffic light: heads hang at `at_m`, on a mast whose foot is at `pole_m`."""

    id: str
    """`<light>/<approach>`, as in `signal_groups`."""
    at_m: Point3
    pole_m: Point2
    facing: tuple[float, float]
    """Unit vector towards the traffic it is for."""


@dataclass(frozen=True)
class PostedSign:
    """A stop or give-way sign."""

    kind: Literal["stop", "yield"]
    at_m: Point2
    facing: tuple[float, float]
    """Unit vector towards the traffic it is for."""


class BuiltRoad(Protocol):
    """What lanes, terrain, surroundings and traffic need of a road; made as it is asked for."""

    @property
    def lanes(self) -> tuple[Lane, ...]:
        """Every lane, way through a junction and crossing."""
        ...

    @property
    def meshes(self) -> list[Mesh]:
        """Roadways, kerbs, sidewalks and paint, without the ground around them."""
        ...

    @property
    def rims(self) -> list[Points]:
        """Edges (n, 3) of all paving, which is on their left, at the height the ground meets."""
        ...

    @property
    def footprint(self) -> BaseGeometry:
        """What is paved, sidewalks included."""
        ...

    @property
    def axes(self) -> BaseGeometry:
        """Axes of the streets."""
        ...

    @property
    def kerbless(self) -> BaseGeometry:
        """Where people on foot are as low as the roadway."""
        ...

    @property
    def heads(self) -> tuple[Head, ...]:
        """Signal heads."""
        ...

    @property
    def signs(self) -> tuple[PostedSign, ...]:
        """Stop and give-way signs."""
        ...
