"""V2X messages that an agent sends in a frame, and what became of them at every other agent.

A station's frame is level: its origin is that of the agent, x points ahead, y left and z up, as
messages of ETSI have no pitch and no roll.
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
    """What a message is, in the order of priority."""

    CAM = "cam"
    """Cooperative awareness: the sender."""
    CPM = "cpm"
    """Collective perception: what the sender perceives."""
    DATA = "data"
    """Sensor data or features, which are in the sender's files."""


class LossReason(StrEnum):
    """Why a message does not arrive."""

    RANGE = "range"
    """The receiver is beyond the channel's range."""
    POWER = "power"
    """The received power is below the sensitivity."""
    CHANNEL = "channel"
    """Lost at random or in a burst."""
    QUEUE = "queue"
    """Not sent when the next one of its kind was due."""
    LIFETIME = "lifetime"
    """Too late to be of use."""


@dataclass(frozen=True, eq=False)
class StationData:
    """What a station says of itself.

    Attributes:
        station_type: `StationType` of ETSI TS 102 894-2: 5 passenger car, 7 light truck, 8 heavy
            truck, 15 roadside unit.
        world_from_station: (4, 4) level pose with the errors of its localisation.
        position_sd_m: Standard deviation of x, y and z, of which the errors were drawn.
        heading_sd_rad: Standard deviation of the heading.
        speed_m_s: Along its x axis.
        acceleration_m_s2: Along its x axis.
        yaw_rate_rad_s: Positive to the left.
        size_m: Length, width and height; None of a roadside unit.
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
    """Objects that a station perceives, n of them, in its frame.

    Attributes:
        ids: (n,) int64 as in annotations: truth, which no message has.
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
    """What became of a message at one other agent.

    Attributes:
        delay_s: Time from the frame to reception; None if it was lost.
        lost: Why it was lost; None if it arrives.
        power_dbm: Received power; None without a radio.
        path: What was on the path, `los`, `nlosv` or `nlos`; None without a radio.
    """

    delay_s: float | None = None
    lost: LossReason | None = None
    power_dbm: float | None = None
    path: str | None = None


@dataclass(frozen=True, eq=False)
class Message:
    """A message as it was sent.

    Attributes:
        kind: What it is.
        size_bytes: Its size on the air.
        timestamp_s: Time of the frame by the sender's clock.
        station: What the sender says of itself.
        objects: What it perceives, in a CPM.
        deliveries: What became of it, by the id of every other agent.
    """

    kind: MessageKind
    size_bytes: int
    timestamp_s: float
    station: StationData
    objects: PerceivedObjects | None
    deliveries: Mapping[str, Delivery]


@dataclass(frozen=True, eq=False)
class SentMessages:
    """What an agent sends in a frame.

    Attributes:
        clock_offset_s: How far its clock is ahead.
        messages: The messages; often none.
    """

    clock_offset_s: float
    messages: tuple[Message, ...] = ()
