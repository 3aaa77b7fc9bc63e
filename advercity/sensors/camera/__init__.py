"""From radiance to picture: air before the lens, glass, lens and electronics."""

from advercity.sensors.camera.electronics import Setting, digitise, expose, meter
from advercity.sensors.camera.picture import CameraAir, in_air, photograph
from advercity.sensors.camera.shot import Shot

__all__ = [
    "CameraAir",
    "Setting",
    "Shot",
    "digitise",
    "expose",
    "in_air",
    "meter",
    "photograph",
]
