"""V2X messages of an agent in a frame, and their delivery to every other agent.

A station's frame is level, as messages of ETSI have no pitch and no roll. Its origin is the
agent's; x points ahead, y left and z up.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from advercity.geometry import poses
from advercity.geometry.poses import Matrix


def to_level_pose(world_from_agent: Matrix) -> Matrix:
    """Return the pose (4, 4) of a station's frame: the agent's without pitch and roll."""
    yaw, _, _ = poses.to_yaw_pitch_roll(world_from_agent)
    x, y, z = world_from_agent[:3, 3].tolist()
    return poses.pose_matrix((x, y, z), yaw=yaw)


class MessageKind(StrEnum):
    """Kind of a message, in the order of priority."""

    CAM = "cam"
    """Cooperative awareness: the sender."""
    CPM = "cpm"
    """Collective perception: objects perceived by the sender."""
    DATA = "data"
    """Sensor data or features, stored in the sender's files."""


class LossReason(StrEnum):
    """Reason for the loss of a message."""

    RANGE = "range"
    """The receiver is beyond the channel's range."""
    POWER = "power"
    """The received power is below the sensitivity."""
    CHANNEL = "channel"
    """Lost at random or in a burst."""
    QUEUE = "queue"
    """Not yet sent when the next message of its kind was due."""
    LIFETIME = "lifetime"
    """Too late to be of use."""


@dataclass(frozen=True, eq=False)
class StationData:
    """A station's report of itself.

    Attributes:
        station_type: `StationType` of ETSI TS 102 894-2: 5 passenger car, 7 light truck, 8 heavy
            truck, 15 roadside unit.
        world_from_station: (4, 4) level pose with the errors of its localisation.
        position_sd_m: Standard deviation of x, y and z for the draw of the errors.
        heading_sd_rad: Standard deviation of the heading.
        speed_m_s: Along its x axis.
        acceleration_m_s2: Along its x axis.
        yaw_rate_rad_s: Positive to the left.
        size_m: Length, width and height; None for a roadside unit.
    """

    station_type: int
    world_from_station: Matrix
    position_sd_m: tuple[float, float, float]
    heading_sd_rad: float
    speed_m_s: float
    acceleration_m_s2: float
    yaw_rate_rad_s: float
    size_m: tuple[float, float, float] | None


@dataclass(frozen=True, eq=False)
class PerceivedObjects:
    """The n objects perceived by a station, in its frame.

    Attributes:
        ids: (n,) int64 as in annotations: truth, absent from real messages.
        classes: (n,) text, as in annotations.
        centres: (n, 3) middles of their boxes, metres.
        headings_rad: (n,) relative to the station, positive to the left.
        sizes_m: (n, 3) length, width and height.
        velocities_m_s: (n, 2) over ground, along x and y of the station's frame.
        position_covariances_m2: (n, 2, 2) of x and y.
        heading_sd_rad: Standard deviation of the headings.
        velocity_sd_m_s: Standard deviation of each component of the velocities.
    """

    ids: NDArray[np.int64]
    classes: NDArray[np.str_]
    centres: NDArray[np.float64]
    headings_rad: NDArray[np.float64]
    sizes_m: NDArray[np.float64]
    velocities_m_s: NDArray[np.float64]
    position_covariances_m2: NDArray[np.float64]
    heading_sd_rad: float
    velocity_sd_m_s: float

    def __len__(self) -> int:
        """Return the number of objects."""
        return len(self.ids)


@dataclass(frozen=True)
class Delivery:
    """Delivery of a message to one other agent.

    Attributes:
        delay_s: Time from the frame to reception; None if it was lost.
        lost: Reason for its loss; None if it arrives.
        power_dbm: Received power; None without a radio.
        path: Kind of path, `los`, `nlosv` or `nlos`; None without a radio.
    """

    delay_s: float | None = None
    lost: LossReason | None = None
    power_dbm: float | None = None
    path: str | None = None


@dataclass(frozen=True, eq=False)
class Message:
    """A sent message.

    Attributes:
        kind: Kind of the message.
        size_bytes: Its size on the air.
        timestamp_s: Time of the frame by the sender's clock.
        station: The sender's report of itself.
        objects: Objects perceived by the sender, in a CPM.
        deliveries: Deliveries, by the id of every other agent.
    """

    kind: MessageKind
    size_bytes: int
    timestamp_s: float
    station: StationData
    objects: PerceivedObjects | None
    deliveries: Mapping[str, Delivery]


@dataclass(frozen=True, eq=False)
class SentMessages:
    """Messages of an agent in a frame.

    Attributes:
        clock_offset_s: Offset of its clock, positive ahead.
        messages: The messages; often none.
    """

    clock_offset_s: float
    messages: tuple[Message, ...] = ()
