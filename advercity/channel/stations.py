"""Messages of stations: their times and contents."""

import math
from collections.abc import Sequence

import numpy as np
from advercity_dsl import Agent
from advercity_dsl.channel import Channel, PerceptionMessage
from numpy.typing import NDArray

from advercity.channel.impairments import ChannelRandomness
from advercity.frames import ActorState, Trace
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array
from advercity.sensors.annotation import annotate_actors
from advercity.sensors.messages import MessageKind, PerceivedObjects, StationData, to_level_pose
from advercity.sensors.sensor_frame import SensorFrame

STATION_TYPES = {"car": 5, "van": 7, "truck": 8}
"""Station type of ETSI TS 102 894-2 by the class of a connected vehicle."""
ROADSIDE_UNIT = 15
CAM_HEADING_RAD = math.radians(4.0)
CAM_DISTANCE_M = 4.0
CAM_SPEED_M_S = 0.5
CAM_MIN_S, CAM_MAX_S = 0.1, 1.0
"""Triggers of a CAM, and limits of the time between two (ETSI EN 302 637-2, clause 6.1.3)."""
REPEATED_CAMS = 3
"""Further CAMs at the interval of one triggered by a change."""
EDGE_S = 1e-6
"""Times are sums of ticks, whose last bits do not count."""


def find_cam_ticks(agent: Agent, trace: Trace) -> frozenset[int]:
    """Find the ticks of a station's CAMs in a trace, by the rules of the standard.

    Vehicles send one when heading, position or speed have changed, and at least every second; three
    more follow one triggered by a change, at its interval. Roadside units send one a second.
    """
    if agent.place.kind == "roadside_unit":
        return frozenset(range(0, len(trace), max(1, round(CAM_MAX_S / trace.tick_s))))
    _, track = trace.get_track(agent.number)
    ticks = track["tick"].tolist()
    columns = ("x", "y", "yaw", "speed")
    rows = list(zip(*(track[name].tolist() for name in columns), strict=True))
    sent = [ticks[0]]
    last, interval_s, repeated = rows[0], CAM_MAX_S, 0
    for tick, row in zip(ticks[1:], rows[1:], strict=True):
        elapsed_s = (tick - sent[-1]) * trace.tick_s
        if elapsed_s < CAM_MIN_S - EDGE_S:
            continue
        if _has_changed(last, row):
            interval_s, repeated = elapsed_s, 0
        elif elapsed_s >= interval_s - EDGE_S:
            repeated += 1
            interval_s = CAM_MAX_S if repeated >= REPEATED_CAMS else interval_s
        else:
            continue
        sent.append(tick)
        last = row
    return frozenset(sent)


def _has_changed(last: Sequence[float], now: Sequence[float]) -> bool:
    turn_rad = abs((now[2] - last[2] + math.pi) % (2 * math.pi) - math.pi)
    moved_m = math.dist(now[:2], last[:2])
    return (
        turn_rad > CAM_HEADING_RAD
        or moved_m > CAM_DISTANCE_M
        or abs(now[3] - last[3]) > CAM_SPEED_M_S
    )


def describe_station(
    sensor_frame: SensorFrame, channel: Channel, randomness: ChannelRandomness
) -> StationData:
    """Describe a station as it describes itself, with the errors of its localisation."""
    agent, error = sensor_frame.agent, channel.pose_error
    world_from_station = to_level_pose(sensor_frame.world_from_agent)
    is_unit = agent.place.kind == "roadside_unit"
    position_sd_m, heading_sd_rad = (0.0, 0.0, 0.0), 0.0
    if not is_unit or error.roadside_units:
        offset, turn_rad = randomness.draw_pose_error(agent.id, sensor_frame.frame.index)
        turned = world_from_station @ poses.pose_matrix((0.0, 0.0, 0.0), yaw=turn_rad)
        world_from_station = turned + np.pad(offset[:, None], ((0, 1), (3, 0)))
        level_m = math.hypot(error.white_noise_m, error.wander_m)
        position_sd_m = (level_m, level_m, level_m * error.vertical_factor)
        heading_deg = math.hypot(error.heading_noise_deg, error.heading_wander_deg)
        heading_sd_rad = math.radians(heading_deg)
    if is_unit:
        return StationData(
            ROADSIDE_UNIT, world_from_station, position_sd_m, heading_sd_rad, 0.0, 0.0, 0.0, None
        )
    state = sensor_frame.frame.get_state(agent.number)
    return StationData(
        station_type=STATION_TYPES[state.actor.actor_class],
        world_from_station=world_from_station,
        position_sd_m=position_sd_m,
        heading_sd_rad=heading_sd_rad,
        speed_m_s=state.speed_m_s,
        acceleration_m_s2=state.acceleration_m_s2,
        yaw_rate_rad_s=float(state.motion.angular_rate[2]),
        size_m=state.actor.size,
    )


def perceive_objects(
    sensor_frame: SensorFrame, message: PerceptionMessage, randomness: ChannelRandomness
) -> PerceivedObjects:
    """Perceive the annotated objects with enough points, the nearest first, with errors.

    Errors are drawn along the line of sight and across it, and the covariances match the drawn
    errors. Positions are relative to the true pose: they have no errors of localisation.
    """
    annotated = annotate_actors(sensor_frame)
    has_lidar = bool(sensor_frame.lidar_scans)
    found = [item for item in annotated if not has_lidar or item.lidar_points >= message.min_points]
    found.sort(key=lambda item: (item.distance_m, item.state.actor.id))
    found = found[: message.max_objects]
    count = len(found)
    station_from_world = poses.invert_pose(to_level_pose(sensor_frame.world_from_agent))
    key = (sensor_frame.agent.id, sensor_frame.frame.index)
    normals = np.reshape(
        [
            randomness.make_generator("object", *key, item.state.actor.id).standard_normal(5)
            for item in found
        ],
        (count, 5),
    )
    centres = poses.transform_points(
        station_from_world,
        np.reshape([_find_steady_centre(item.state) for item in found], (count, 3)),
    )
    velocities = np.reshape([item.state.motion.velocity for item in found], (count, 3))
    level_velocities = velocities @ station_from_world[:3, :3].T
    along, across, covariances = _measure_errors(centres, message)
    centres[:, :2] += along * normals[:, :1] + across * normals[:, 1:2]
    headings = np.array([item.relative_yaw_rad for item in found])
    return PerceivedObjects(
        ids=np.array([item.state.actor.id for item in found], np.int64),
        classes=np.array([item.state.actor.actor_class for item in found], np.str_),
        centres=centres,
        headings_rad=headings + math.radians(message.heading_noise_deg) * normals[:, 2],
        sizes_m=np.reshape([item.state.steady_box.size for item in found], (count, 3)),
        velocities_m_s=level_velocities[:, :2] + message.speed_noise_m_s * normals[:, 3:],
        position_covariances_m2=covariances,
        heading_sd_rad=math.radians(message.heading_noise_deg),
        velocity_sd_m_s=message.speed_noise_m_s,
    )


def _find_steady_centre(state: ActorState) -> Float64Array:
    """Find the middle (3,) of an object in the world: trackers even strides out."""
    return poses.transform_points(state.world_from_body, state.steady_box.centre)


def _measure_errors(
    centres: Float64Array, message: PerceptionMessage
) -> tuple[Float64Array, Float64Array, NDArray[np.float64]]:
    """Compute the errors (n, 2) of one standard deviation along and across, and covariances."""
    distance_m = np.maximum(np.linalg.norm(centres[:, :2], axis=1), 1e-6)[:, None]
    ahead = centres[:, :2] / distance_m
    left = ahead[:, ::-1] * np.array([-1.0, 1.0])
    along = message.range_noise_m * ahead
    across = math.radians(message.bearing_noise_deg) * distance_m * left
    covariances = along[:, :, None] * along[:, None] + across[:, :, None] * across[:, None]
    return along, across, covariances


def compute_size_bytes(
    kind: MessageKind, channel: Channel, agent: Agent, objects: PerceivedObjects | None
) -> int:
    """Compute the size of a message on the air."""
    if kind is MessageKind.CAM and channel.cam is not None:
        return round(channel.cam.size_bytes)
    if kind is MessageKind.CPM and channel.cpm is not None and objects is not None:
        sensors, cpm = agent.sensors, channel.cpm
        count = len(sensors.cameras) + len(sensors.lidars) + len(sensors.radars)
        size = cpm.header_bytes + cpm.sensor_bytes * count + cpm.object_bytes * len(objects)
        return round(size)
    assert channel.data is not None, f"a message of kind {kind} that the channel does not have"
    return round(channel.data.size_bytes)
