"""The JSON document of the V2X messages sent by an agent in a frame.

`<frame>_messages.json` is left-handed, in metres, m/s and degrees. `deliveries`, `clock_offset_s`
and the `id` of an object are truth: no receiver has them. `received_messages` reads it.
"""

import math
from typing import Any

import numpy as np

from advercity.dataset.carla_frame import carla_pose_from_matrix, mirror_angle, mirror_points
from advercity.dataset.plain_documents import to_plain
from advercity.frames import Frame
from advercity.sensors.messages import (
    Delivery,
    Message,
    PerceivedObjects,
    SentMessages,
    StationData,
)

_MIRROR_XY = np.array([1.0, -1.0])


def build_messages_document(frame: Frame, sent: SentMessages) -> dict[str, Any]:
    """Build the document `<frame>_messages.json` of an agent."""
    return {
        "frame": frame.index,
        "time_s": to_plain(frame.time_s),
        "clock_offset_s": to_plain(sent.clock_offset_s),
        "messages": [_describe_message(message) for message in sent.messages],
    }


def _describe_message(message: Message) -> dict[str, Any]:
    objects = {} if message.objects is None else _describe_objects(message.objects)
    return {
        "kind": message.kind.value,
        "size_bytes": message.size_bytes,
        "timestamp_s": to_plain(message.timestamp_s),
        "station": _describe_station(message.station),
        **objects,
        "deliveries": {name: _describe_delivery(item) for name, item in message.deliveries.items()},
    }


def _describe_station(station: StationData) -> dict[str, Any]:
    yaw_rate_deg_s = math.degrees(station.yaw_rate_rad_s)
    return {
        "type": station.station_type,
        "pose": to_plain(carla_pose_from_matrix(station.world_from_station)),
        "position_sd_m": to_plain(station.position_sd_m),
        "heading_sd_deg": to_plain(math.degrees(station.heading_sd_rad)),
        "speed_m_s": to_plain(station.speed_m_s),
        "acceleration_m_s2": to_plain(station.acceleration_m_s2),
        "yaw_rate_deg_s": to_plain(mirror_angle(yaw_rate_deg_s)),
        "size_m": None if station.size_m is None else to_plain(station.size_m),
    }


def _describe_objects(objects: PerceivedObjects) -> dict[str, Any]:
    centres = to_plain(mirror_points(objects.centres), decimals=6)
    headings = to_plain(mirror_angle(np.rad2deg(objects.headings_rad)), decimals=6)
    velocities = to_plain(objects.velocities_m_s * _MIRROR_XY, decimals=6)
    covariances = objects.position_covariances_m2
    # The covariance of x and y changes its sign with y, their variances do not.
    xx, xy, yy = covariances[:, 0, 0], -covariances[:, 0, 1], covariances[:, 1, 1]
    rows = zip(
        objects.ids.tolist(),
        objects.classes.tolist(),
        centres,
        headings,
        to_plain(objects.sizes_m, decimals=6),
        velocities,
        to_plain(np.column_stack([xx, xy, yy]), decimals=9),
        strict=True,
    )
    return {
        "heading_sd_deg": to_plain(math.degrees(objects.heading_sd_rad)),
        "velocity_sd_m_s": to_plain(objects.velocity_sd_m_s),
        "objects": [
            {
                "id": number,
                "class": name,
                "centre_m": centre,
                "heading_deg": heading,
                "size_m": size,
                "velocity_m_s": velocity,
                "covariance_m2": covariance,
            }
            for number, name, centre, heading, size, velocity, covariance in rows
        ],
    }


def _describe_delivery(delivery: Delivery) -> dict[str, Any]:
    """Describe the fate of a message; fields without a value are left out."""
    described: dict[str, Any] = {}
    if delivery.delay_s is not None:
        described["delay_s"] = to_plain(delivery.delay_s)
    if delivery.lost is not None:
        described["lost"] = delivery.lost.value
    if delivery.power_dbm is not None:
        described["power_dbm"] = to_plain(delivery.power_dbm, decimals=3)
    if delivery.path is not None:
        described["path"] = delivery.path
    return described
