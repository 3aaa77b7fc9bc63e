"""Position and motion of a vehicle as KITTI's inertial unit writes them: 30 columns of text.

Position, attitude and speed are the true ones, since KITTI's unit is its reference too. Rates and
accelerations come from the agent's own inertial unit, or are a resting body's without one.
"""

import numpy as np

from advercity.dataset.agent_view import AgentView
from advercity.dataset.reader import FrameView
from advercity.geometry import poses
from advercity.geometry.geodesy import find_world_origin, geodetic_from_enu

GRAVITY_M_S2 = 9.81
LOCKED = 4
"""KITTI's number for a unit whose position is fixed in all axes."""


def format_oxts(frame: FrameView, view: AgentView) -> str:
    """Format a line: position, attitude, velocities, accelerations, rates, and states of the unit.

    Attitude is roll, pitch and yaw in radians, positive with the left side up, the front down and
    to the left; yaw 0 is east. Numbers of satellites and accuracies are 0.
    """
    pose = view.world_from_agent
    origin = find_world_origin(frame.scenario.spec.road)
    place = geodetic_from_enu(pose[:3, 3], origin)
    yaw, pitch, roll = poses.to_yaw_pitch_roll(pose)
    velocity = view.speed_m_s * pose[:3, 0]
    _, imu = view.motion
    force = pose[:3, :3].T @ (0.0, 0.0, GRAVITY_M_S2) if imu is None else imu.specific_force
    rate = np.zeros(3) if imu is None else imu.angular_rate
    # The axes f, l, u are level, but turned with the vehicle.
    level_from_body = poses.rotation_matrix(pitch=pitch, roll=roll)
    numbers = [
        *(place.latitude_deg, place.longitude_deg, place.altitude_m),
        *(roll, pitch, yaw),
        *(velocity[1], velocity[0]),
        *(level_from_body @ (view.speed_m_s, 0.0, 0.0)),
        *force,
        *(level_from_body @ force),
        *rate,
        *(level_from_body @ rate),
        *(0.0, 0.0),
    ]
    return " ".join([*(f"{value:.12g}" for value in numbers), f"{LOCKED} 0 0 0 0"]) + "\n"
