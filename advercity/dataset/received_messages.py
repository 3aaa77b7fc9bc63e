"""V2X messages received by an agent, read from the files of their senders."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView, report_read_errors
from advercity.dataset.carla_frame import matrix_from_carla_pose, mirror_angle, mirror_points
from advercity.errors import InputError
from advercity.geometry import poses
from advercity.geometry.poses import Matrix
from advercity.sensors.messages import (
    Delivery,
    LossReason,
    Message,
    MessageKind,
    PerceivedObjects,
    SentMessages,
    StationData,
    to_level_pose,
)

if TYPE_CHECKING:
    from advercity.dataset.reader import FrameView

_MIRROR_XY = np.array([1.0, -1.0])
EDGE_S = 1e-6
"""Times are sums of ticks, whose last bits do not count."""


@dataclass(frozen=True, eq=False)
class ReceivedMessage:
    """A message received by an agent.

    Attributes:
        kind: `cam`, `cpm` or `data`.
        sender: Id of the sending agent.
        view: The sender's data in the frame of sending: its clouds, images and truth.
        age_s: Time since that frame.
        clock_age_s: The same by the clocks of receiver and sender, as the receiver computes it.
        arrived_s: Time since it arrived.
        station: The sender's state; its pose has the errors of its localisation.
        objects: The sender's perceived objects, in its frame; None if the message is no CPM.
    """

    kind: MessageKind
    sender: str
    view: AgentView
    age_s: float
    clock_age_s: float
    arrived_s: float
    station: StationData
    objects: PerceivedObjects | None

    @property
    def world_from_lidar(self) -> Matrix:
        """Pose (4, 4) of the sender's first LiDAR, derived from the transmitted pose.

        `view.world_from_lidar` is the true one.
        """
        level = to_level_pose(self.view.world_from_agent)
        return (
            self.station.world_from_station
            @ poses.invert_pose(level)
            @ (self.view.world_from_lidar)
        )

    @property
    def world_from_objects(self) -> NDArray[np.float64]:
        """Poses (n, 4, 4) of the perceived objects' boxes by the transmitted pose."""
        if self.objects is None:
            return np.empty((0, 4, 4))
        station_from_objects = [
            poses.pose_matrix((x, y, z), yaw=yaw)
            for (x, y, z), yaw in zip(
                self.objects.centres.tolist(), self.objects.headings_rad.tolist(), strict=True
            )
        ]
        return self.station.world_from_station @ np.reshape(station_from_objects, (-1, 4, 4))


def load_sent_messages(view: AgentView) -> SentMessages:
    """Load an agent's messages of a frame; InputError if there is no such file."""
    document, path = view.load_messages_document(), view.path(view.messages_suffix)
    with report_read_errors(path):
        return SentMessages(
            clock_offset_s=float(document["clock_offset_s"]),
            messages=tuple(_parse_message(item) for item in document["messages"]),
        )


def find_received_messages(
    frame: FrameView, receiver: str, *, latest: bool = True
) -> Iterator[ReceivedMessage]:
    """Find the messages received by an agent up to a frame, the newest of a sender first.

    Args:
        frame: The frame.
        receiver: Id of the agent.
        latest: Only the newest of each sender and kind; else all within the channel's lifetime.
    """
    scenario = frame.scenario
    channel, tick_s = scenario.spec.channel, scenario.spec.timing.tick_s
    if channel is None:
        message = "has no messages: its suite names no channel"
        raise InputError(f"{scenario.path}: {message}")
    kinds = {name for name in MessageKind if getattr(channel, name.value) is not None}
    offset_s = load_sent_messages(frame[receiver]).clock_offset_s
    oldest = frame.index - math.floor(channel.lifetime_s / tick_s + EDGE_S)
    written = [index for index in scenario.frame_numbers if oldest <= index <= frame.index]
    for sender in scenario.agents:
        missing = set(kinds) if sender != receiver else set[MessageKind]()
        for index in reversed(written):
            if not missing:
                break
            view = scenario.frame(index)[sender]
            for message in load_sent_messages(view).messages:
                age_s = (frame.index - index) * tick_s
                delay_s = message.deliveries[receiver].delay_s
                is_wanted = message.kind in missing or not latest
                if delay_s is None or delay_s > age_s + EDGE_S or not is_wanted:
                    continue
                if latest:
                    missing.discard(message.kind)
                yield ReceivedMessage(
                    kind=message.kind,
                    sender=sender,
                    view=view,
                    age_s=age_s,
                    clock_age_s=frame.time_s + offset_s - message.timestamp_s,
                    arrived_s=age_s - delay_s,
                    station=message.station,
                    objects=message.objects,
                )


def _parse_message(item: dict[str, Any]) -> Message:
    return Message(
        kind=MessageKind(item["kind"]),
        size_bytes=int(item["size_bytes"]),
        timestamp_s=float(item["timestamp_s"]),
        station=_parse_station(item["station"]),
        objects=_parse_objects(item) if "objects" in item else None,
        deliveries={name: _parse_delivery(found) for name, found in item["deliveries"].items()},
    )


def _parse_station(item: dict[str, Any]) -> StationData:
    x_m, y_m, z_m = item["position_sd_m"]
    size_m = item["size_m"]
    return StationData(
        station_type=int(item["type"]),
        world_from_station=matrix_from_carla_pose(item["pose"]),
        position_sd_m=(float(x_m), float(y_m), float(z_m)),
        heading_sd_rad=math.radians(item["heading_sd_deg"]),
        speed_m_s=float(item["speed_m_s"]),
        acceleration_m_s2=float(item["acceleration_m_s2"]),
        yaw_rate_rad_s=mirror_angle(math.radians(item["yaw_rate_deg_s"])),
        size_m=None if size_m is None else (float(size_m[0]), float(size_m[1]), float(size_m[2])),
    )


def _parse_objects(item: dict[str, Any]) -> PerceivedObjects:
    rows = item["objects"]

    def parse_column(name: str, *shape: int) -> NDArray[np.float64]:
        return np.reshape([row[name] for row in rows], (len(rows), *shape)).astype(np.float64)

    xx, xy, yy = parse_column("covariance_m2", 3).T
    return PerceivedObjects(
        ids=np.array([row["id"] for row in rows], np.int64),
        classes=np.array([row["class"] for row in rows], np.str_),
        centres=mirror_points(parse_column("centre_m", 3)),
        headings_rad=mirror_angle(np.deg2rad(parse_column("heading_deg"))),
        sizes_m=parse_column("size_m", 3),
        velocities_m_s=parse_column("velocity_m_s", 2) * _MIRROR_XY,
        position_covariances_m2=np.reshape(np.column_stack([xx, -xy, -xy, yy]), (-1, 2, 2)),
        heading_sd_rad=math.radians(item["heading_sd_deg"]),
        velocity_sd_m_s=float(item["velocity_sd_m_s"]),
    )


def _parse_delivery(item: dict[str, Any]) -> Delivery:
    lost = item.get("lost")
    return Delivery(
        delay_s=item.get("delay_s"),
        lost=None if lost is None else LossReason(lost),
        power_dbm=item.get("power_dbm"),
        path=item.get("path"),
    )
