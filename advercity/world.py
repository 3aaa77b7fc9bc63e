"""The static stage of a scenario and the bodies that move on it, as plain meshes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.mesh import Mesh
from advercity.roads.lane_segments import LaneSegment


@dataclass(frozen=True, eq=False)
class Gait:
    """How a body moves on the spot while it goes: a cycle of poses.

    Attributes:
        cycle_length_m: Way that it goes in a cycle.
        bone_transforms: (poses, bones, 3, 4) float32 from the body at rest to each pose.
        returns_to_rest: Whether it stands as it is at rest while it does not go; else it keeps its
            pose.
    """

    cycle_length_m: float
    bone_transforms: NDArray[np.float32]
    returns_to_rest: bool


@dataclass(frozen=True)
class Body:
    """What an actor of a blueprint looks like, in its body frame (origin on the ground)."""

    parts: tuple[Mesh, ...]
    size: tuple[float, float, float]
    """Full length, width and height in metres of the box, which stands centred on the origin."""
    gait: Gait | None = None
    with_umbrella: "Body | None" = None
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
class World:
    """A place, ready to be rendered, cast into and driven on."""

    id: str
    static: tuple[Mesh, ...]
    bodies: Mapping[str, Body]
    """By blueprint id; every blueprint of the spec has one."""
    lanes: tuple[LaneSegment, ...]
    network: Path
    """SUMO network, whose coordinates are the world's."""
    street_lamps: tuple[StreetLamp, ...] = ()
    signal_lamps: tuple[SignalLamp, ...] = field(default=())
