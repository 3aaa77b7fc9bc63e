"""LiDARs: beams, returns through the air, and reported points.

Points are in the LiDAR frame: right-handed, x forward, y left, z up. The head rotates
counterclockwise from straight ahead and fires all channels at each azimuth; sensors with prisms or
a limited field of view follow `ScanPattern`.
"""

from advercity.sensors.lidar.beams import ScanTime, beam_directions, channel_elevations_rad
from advercity.sensors.lidar.conditions import LidarConditions, derive_lidar_conditions
from advercity.sensors.lidar.point_cloud import measure_point_cloud
from advercity.sensors.lidar.scan import ScanHits, cast_scan
from advercity.sensors.measurements import PointCloud, PointKind

__all__ = [
    "LidarConditions",
    "PointCloud",
    "PointKind",
    "ScanHits",
    "ScanTime",
    "beam_directions",
    "cast_scan",
    "channel_elevations_rad",
    "derive_lidar_conditions",
    "measure_point_cloud",
]
