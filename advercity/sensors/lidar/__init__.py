"""A spinning LiDAR: its beams, what comes back through the air, and the points it reports.

Points are in the LiDAR's own frame, right-handed, x forward, y left, z up. Beams turn
counter-clockwise from straight ahead, all channels at each azimuth.
"""

from advercity.sensors.lidar.air import LidarAir, air_of
from advercity.sensors.lidar.beams import beams, elevations_rad
from advercity.sensors.lidar.cloud import PointCloud, PointKind
from advercity.sensors.lidar.scanning import Scan, shoot, visible_counts
from advercity.sensors.lidar.turn import sweep

__all__ = [
    "LidarAir",
    "PointCloud",
    "PointKind",
    "Scan",
    "air_of",
    "beams",
    "elevations_rad",
    "shoot",
    "sweep",
    "visible_counts",
]
