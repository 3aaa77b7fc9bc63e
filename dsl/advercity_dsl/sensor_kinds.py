"""The kinds of sensors of this installation: of advercity, then of other packages.

Another distribution registers its `SensorKind`, under the kind's name, as an entry point of the
group `advercity.sensors`.
"""

from collections.abc import Mapping
from functools import cache

from advercity_dsl.camera import Camera
from advercity_dsl.can_bus import CanBus
from advercity_dsl.inertial import Imu
from advercity_dsl.lidar import Lidar
from advercity_dsl.positioning import Gnss
from advercity_dsl.radar import Radar
from advercity_dsl.registry import Registered, check_model, load_registered
from advercity_dsl.sampling import Sampled
from advercity_dsl.sensor_kind import SensorKind
from advercity_dsl.thermal import ThermalCamera

_DATASET, _SENSORS = "advercity.dataset", "advercity.sensors"
_VIEWS = "advercity.viewer.sensor_views"
CORE_KINDS = {
    kind.name: kind
    for kind in (
        SensorKind(
            "camera",
            "camera",
            Camera,
            "aimed",
            files=f"{_DATASET}.camera_files:FILES",
            driver=f"{_SENSORS}.camera.driver:CameraDriver",
            show=f"{_VIEWS}:show_camera",
        ),
        SensorKind(
            "lidar",
            "LiDAR",
            Lidar,
            "level",
            files=f"{_DATASET}.lidar_files:FILES",
            driver=f"{_SENSORS}.lidar.driver:LidarDriver",
            show=f"{_VIEWS}:show_lidar",
        ),
        SensorKind(
            "radar",
            "radar",
            Radar,
            "aimed",
            files=f"{_DATASET}.radar_files:FILES",
            driver=f"{_SENSORS}.radar.driver:RadarDriver",
            show=f"{_VIEWS}:show_radar",
        ),
        SensorKind(
            "thermal",
            "thermal camera",
            ThermalCamera,
            "aimed",
            files=f"{_DATASET}.thermal_files:FILES",
            driver=f"{_SENSORS}.thermal.driver:ThermalDriver",
            show=f"{_VIEWS}:show_thermal",
        ),
        SensorKind(
            "gnss",
            "satellite receiver",
            Gnss,
            "body",
            files=f"{_DATASET}.motion_files:GNSS",
            driver=f"{_SENSORS}.gnss.driver:GnssDriver",
            show=f"{_VIEWS}:show_gnss",
        ),
        SensorKind(
            "imu",
            "inertial unit",
            Imu,
            "body",
            files=f"{_DATASET}.motion_files:IMU",
            driver=f"{_SENSORS}.motion_drivers:ImuDriver",
            show=f"{_VIEWS}:show_imu",
        ),
        SensorKind(
            "can",
            "bus",
            CanBus,
            "body",
            files=f"{_DATASET}.motion_files:CAN",
            driver=f"{_SENSORS}.motion_drivers:CanDriver",
            not_on_units="a roadside unit has no wheels",
        ),
    )
}
"""The kinds of advercity by name."""


@cache
def load_sensor_kinds() -> Registered[SensorKind]:
    """Load the kinds of this installation."""
    return load_registered("advercity.sensors", CORE_KINDS, SensorKind, _check_kind)


def _check_kind(kind: SensorKind, others: Mapping[str, SensorKind]) -> None:
    check_model(kind.name, kind.model, Sampled)
