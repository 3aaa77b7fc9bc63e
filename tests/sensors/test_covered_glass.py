"""The cover of glass, the same for cameras, LiDARs and radars."""

import pytest
from advercity_dsl import Lidar, Mount
from advercity_dsl.weather_components import Lens

from advercity.sensors.camera.optics import glass_coverage
from advercity.sensors.lidar.beams import ScanTime
from advercity.sensors.lidar.conditions import LidarWindow
from advercity.sensors.radar.conditions import RadarConditions

COVERAGE = 0.1, 0.2, 0.3
FRONT, SIDE, REAR = range(3)


@pytest.mark.parametrize(
    ("yaw_deg", "side"),
    [
        *((0.0, FRONT), (44.9, FRONT), (-44.9, FRONT), (315.1, FRONT)),
        *((45.0, SIDE), (-45.0, SIDE), (134.9, SIDE), (225.1, SIDE)),
        *((135.0, REAR), (-135.0, REAR), (225.0, REAR), (180.0, REAR), (-180.0, REAR)),
    ],
)
def test_glass_at_the_same_yaw_is_on_the_same_side_for_every_sensor(
    yaw_deg: float, side: int
) -> None:
    lens = Lens.model_validate(
        {"enabled": True, "coverage": dict(zip(("front", "side", "rear"), COVERAGE, strict=True))}
    )
    assert glass_coverage(lens, Mount(yaw_deg=yaw_deg)) == COVERAGE[side]
    radome = RadarConditions(radome_db=COVERAGE)
    assert radome.select_radome_db(Mount(yaw_deg=yaw_deg)) == COVERAGE[side]
    # The middle of the first sector is half a degree to the left of the sensor's x axis.
    window = LidarWindow.from_lidar(
        Lidar(), ScanTime(0.0, 0.1), COVERAGE, ("test",), mount_yaw_deg=yaw_deg - 0.5
    )
    assert window is not None
    assert window.gain[0] == pytest.approx((1.0 - 0.3 * COVERAGE[side]) ** 2)
