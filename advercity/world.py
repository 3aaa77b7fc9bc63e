"""Defines the world of a scenario: its static meshes, and the bodies of its actors."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.mesh import Mesh
from advercity.material_maps import MaterialMaps
from advercity.roads.lane_segments import LaneSegment
from advercity.signal_heads import GovernedTraffic


@dataclass(frozen=True, eq=False)
class Gait:
    """A body's cycle of poses, repeated while its actor moves: strides, turns of the pedals.

    Attributes:
        cycle_length_m: Distance travelled in a cycle.
        bone_transforms: (poses, bones, 3, 4) float32 from the body at rest to each pose.
        returns_to_rest: Whether the body takes its rest pose when the actor stops, as people do;
            else it keeps the pose in which it stopped, as pedals do.
    """

    cycle_length_m: float
    bone_transforms: NDArray[np.float32]
    returns_to_rest: bool


@dataclass(frozen=True)
class Body:
    """Shape of the actors of a blueprint, in the body frame (origin on the ground)."""

    parts: tuple[Mesh, ...]
    size: tuple[float, float, float]
    """Length, width and height of the box in metres; its base is centred on the origin."""
    gait: Gait | None = None
    with_umbrella: "Body | None" = None
    """The same body holding an umbrella, which extends beyond the box."""
    others: tuple["Body", ...] = ()
    """Bodies of other people, or semi-trailers, of the blueprint, in boxes of the same size."""


@dataclass(frozen=True)
class StreetLamp:
    """A light straight down at night; its mast is among the static meshes."""

    position: tuple[float, float, float]
    flux_lm: float = 8000.0


@dataclass(frozen=True)
class SignalLamp:
    """Lenses of a traffic-light head, as `SIGNAL_HEADS` arranges them."""

    id: str
    """`<junction>/<street>`: the controlled approach; several heads may have the same."""
    position: tuple[float, float, float]
    """Middle of the head's face."""
    facing: tuple[float, float]
    """Unit vector (x, y) towards its traffic."""
    governs: GovernedTraffic = "vehicles"


@dataclass(frozen=True)
class World:
    """A place with its bodies, ready for renderers, ray casting and traffic."""

    id: str
    static: tuple[Mesh, ...]
    bodies: Mapping[str, Body]
    """By blueprint id; every blueprint of the spec has one."""
    lanes: tuple[LaneSegment, ...]
    network: Path
    """SUMO network; it has the coordinates of the world, of left-hand traffic mirrored."""
    is_left_hand: bool = False
    """Whether traffic drives on the left."""
    street_lamps: tuple[StreetLamp, ...] = ()
    signal_lamps: tuple[SignalLamp, ...] = ()
    material_maps: Mapping[str, MaterialMaps] = field(default_factory=dict[str, MaterialMaps])
    """Images of surfaces by their name in materials."""
