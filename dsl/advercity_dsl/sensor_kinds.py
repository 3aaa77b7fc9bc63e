"""The kinds of sensors of this installation: of advercity, then of other packages.

Another distribution registers its `SensorKind`, under the kind's name, as an entry point of the
group `advercity.sensors`.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import entry_points
from itertools import groupby
from operator import itemgetter
from typing import Any, NamedTuple

from advercity_dsl.camera import Camera
from advercity_dsl.can_bus import CanBus
from advercity_dsl.inertial import Imu
from advercity_dsl.lidar import Lidar
from advercity_dsl.positioning import Gnss
from advercity_dsl.radar import Radar
from advercity_dsl.sampling import Sampled
from advercity_dsl.sensor_kind import SensorKind, load_named
from advercity_dsl.thermal import ThermalCamera

ENTRY_POINT_GROUP = "advercity.sensors"
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


class SensorKinds(NamedTuple):
    """Kinds of an installation.

    Attributes:
        found: Kinds by name.
        broken: Reasons why other registered kinds cannot be used, by name.
        distributions: Names of the distributions that register kinds, by name of the kind.
    """

    found: Mapping[str, SensorKind]
    broken: Mapping[str, str]
    distributions: Mapping[str, str]


@cache
def load_sensor_kinds() -> SensorKinds:
    """Load the kinds of this installation."""
    found, broken = dict(CORE_KINDS), dict[str, str]()
    # By name: the order of installation must not matter. One on two paths is listed twice.
    entries = entry_points(group=ENTRY_POINT_GROUP)
    distributions = {entry.name: entry.dist.name if entry.dist else "" for entry in entries}
    claimed = sorted({(entry.name, entry.value) for entry in entries})
    for name, claims in groupby(claimed, key=itemgetter(0)):
        try:
            found[name] = _load_kind(name, [value for _, value in claims])
        except Exception as error:  # modules of others may raise anything
            broken[name] = str(error)
    return SensorKinds(found, broken, distributions)


def _load_kind(name: str, values: Sequence[str]) -> SensorKind:
    """Load the only record of a name; ValueError if there is none, or several claim it."""
    claims = [*(["advercity"] if name in CORE_KINDS else []), *values]
    if len(claims) > 1:
        raise ValueError(f"the name is claimed by {', '.join(claims)}; uninstall all but one")
    kind = load_named(values[0])
    if not isinstance(kind, SensorKind) or kind.name != name:
        raise ValueError(f"{values[0]} is no SensorKind with the name '{name}'")
    model: Any = kind.model
    if not issubclass(model, Sampled):
        raise ValueError(f"{values[0]} has a model that is not derived from Sampled")
    return kind
