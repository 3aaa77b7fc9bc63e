"""The static stage of a scenario and the bodies that move on it, as plain meshes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from advercity.semantics import Semantic


@dataclass(frozen=True, order=True)
class Wheel:
    """A wheel that stands on the ground, or several that share an axle and do not steer."""

    hub: tuple[float, float, float]
    """Its middle in the body frame, metres; as high as its radius."""
    steers: bool = False

    @property
    def radius_m(self) -> float:
        """How far the hub is above the ground."""
        return self.hub[2]


@dataclass(frozen=True)
class Mesh:
    """Triangles of one material and one semantic class.

    Attributes:
        name: Unique within its world or body.
        vertices: (n, 3) float32, metres.
        triangles: (m, 3) int32 into `vertices`, counter-clockwise seen from outside.
        material: Key of `advercity.world.materials.MATERIALS`.
        semantic: What it is.
        normals: (n, 3) float32 for smooth shading, or None for flat faces.
        weights: (n, bones) float32 shares of what carries each vertex as its body moves on the
            spot, or None if it keeps still.
        wheel: What it turns with, or None if it does not.
    """

    name: str
    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    material: str
    semantic: Semantic
    normals: NDArray[np.float32] | None = None
    weights: NDArray[np.float32] | None = None
    wheel: Wheel | None = None


@dataclass(frozen=True, eq=False)
class Gait:
    """How a body moves on the spot while it goes: a cycle of poses.

    Attributes:
        cycle_m: Way that it goes in a cycle.
        moves: (poses, bones, 3, 4) float32 from the body at rest to each pose.
        rests: Whether it stands as it is at rest while it does not go; else it keeps its pose.
    """

    cycle_m: float
    moves: NDArray[np.float32]
    rests: bool


@dataclass(frozen=True)
class Body:
    """What an actor of a blueprint looks like, in its body frame (origin on the ground)."""

    parts: tuple[Mesh, ...]
    size: tuple[float, float, float]
    """Full length, width and height in metres of the box, which stands centred on the origin."""
    gait: Gait | None = None
    sheltered: "Body | None" = None
    """The same under an umbrella, which reaches beyond the box."""


@dataclass(frozen=True)
class StreetLamp:
    """A lamp that shines straight down at night, without its own mesh."""

    position: tuple[float, float, float]
    flux_lm: float = 8000.0


@dataclass(frozen=True)
class SignalLamp:
    """A traffic-light head: its lenses, from top to bottom red, yellow, green."""

    id: str
    """`<junction>/<street>`: the approach it is for."""
    position: tuple[float, float, float]
    """Middle of the yellow lens, on its face."""
    facing: tuple[float, float]
    """Unit vector (x, y) towards the traffic it is for."""


@dataclass(frozen=True)
class Lane:
    """A lane as annotations and maps need it.

    Attributes:
        id: `<street>.<number>` with `+` along or `-` against the axis, or a junction movement.
        kind: driving, parking, shoulder, sidewalk or crossing.
        left: (n, 3) left border in the direction of travel, metres.
        right: (n, 3) right border, point by point beside `left`.
        in_junction: Whether it lies inside a junction, where borders are not painted.
    """

    id: str
    kind: str
    left: NDArray[np.float64]
    right: NDArray[np.float64]
    in_junction: bool = False


@dataclass(frozen=True)
class World:
    """A place, ready to be rendered, cast into and driven on."""

    id: str
    static: tuple[Mesh, ...]
    bodies: Mapping[str, Body]
    """By blueprint id; every blueprint of the spec has one."""
    lanes: tuple[Lane, ...]
    network: Path
    """SUMO network, whose coordinates are the world's."""
    street_lamps: tuple[StreetLamp, ...] = ()
    signal_lamps: tuple[SignalLamp, ...] = field(default=())
