"""A radar at its place in a frame."""

from dataclasses import dataclass

from advercity_dsl import Mount, Radar

from advercity.geometry.arrays import Float64Array
from advercity.geometry.poses import Matrix


@dataclass(frozen=True, eq=False)
class PlacedRadar:
    """A radar at its place in a frame.

    Attributes:
        radar: The sensor.
        mount: Its mount, which decides the loss of its radome.
        world_from_radar: (4, 4) pose.
        velocity: (3,) in the world, m/s.
        carrier: Id of its vehicle; 0 for a roadside unit.
    """

    radar: Radar
    mount: Mount
    world_from_radar: Matrix
    velocity: Float64Array
    carrier: int = 0
