"""GNSS receivers: noise alone, or satellites among walls and trees."""

from advercity.sensors.gnss.noise_models import measure_gnss
from advercity.sensors.gnss.receiver import ReceiverInPlace
from advercity.sensors.gnss.signal_paths import SkyView

__all__ = ["ReceiverInPlace", "SkyView", "measure_gnss"]
