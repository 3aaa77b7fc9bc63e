"""A 4-D radar at 77 GHz: paths of its waves by rays, weather, and detections.

Detections are in the radar's frame: right-handed, x forward, y left, z up. The radial velocity of
receding targets is positive.
"""

from advercity.sensors.radar.conditions import RadarConditions, derive_radar_conditions
from advercity.sensors.radar.detections import RadarMeasurement
from advercity.sensors.radar.interference import compute_interference
from advercity.sensors.radar.motion import SceneMotion
from advercity.sensors.radar.paths import Paths, SurfacePaths, trace_paths
from advercity.sensors.radar.placement import PlacedRadar
from advercity.sensors.radar.scan import scan_radar

__all__ = [
    "Paths",
    "PlacedRadar",
    "RadarConditions",
    "RadarMeasurement",
    "SceneMotion",
    "SurfacePaths",
    "compute_interference",
    "derive_radar_conditions",
    "scan_radar",
    "trace_paths",
]
