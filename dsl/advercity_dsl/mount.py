"""Poses of sensors on their carriers.

In the body frame: x forward, y left, z up, metres, origin on the ground below the centre of the
vehicle. A positive pitch looks down, a positive yaw left.
"""

from typing import Annotated

from pydantic import Field

from advercity_dsl.base import CompactModel
from advercity_dsl.units import Degrees, Metres, RangeReason

MountOffset = Annotated[
    Metres, Field(ge=-100, le=100), RangeReason("a sensor is on its carrier, within 100 m")
]
Elevation = Annotated[
    Degrees, Field(ge=-90, le=90), RangeReason("90 deg is straight up, -90 deg straight down")
]


class Mount(CompactModel):
    """Pose of a sensor on its carrier."""

    x_m: MountOffset = 0
    """Forward of the origin."""
    y_m: MountOffset = 0
    """Left of the origin."""
    z_m: MountOffset = 0
    """Above the ground."""
    yaw_deg: Degrees = 0
    """Positive turns left."""
    pitch_deg: Degrees = 0
    """Positive looks down."""
    roll_deg: Degrees = 0
    """Positive lowers the right side."""
