"""Measurements of receiver, inertial unit and bus, as files of motion hold them."""

from typing import Any

import numpy as np

from advercity.dataset.carla_frame import mirror_angular_rate, mirror_points
from advercity.sensors.measurements import (
    CanSample,
    GnssFix,
    GnssSolution,
    ImuSample,
    Indicator,
    SolutionQuality,
)


def parse_gnss(fix: dict[str, Any]) -> GnssFix:
    """Parse a fix of a receiver; its latitude and longitude are in degrees."""
    return GnssFix(
        latitude_deg=fix["lat"],
        longitude_deg=fix["lon"],
        altitude_m=fix["alt"],
        time_s=fix["timestamp"],
        heading_rad=fix.get("heading"),
        quality=_parse_quality(fix) if "solution" in fix else None,
        earlier=tuple(map(parse_gnss, fix.get("earlier", ()))),
    )


def _parse_quality(fix: dict[str, Any]) -> SolutionQuality:
    return SolutionQuality(
        solution=GnssSolution(fix["solution"]),
        satellites=fix["satellites"],
        visible=fix["visible"],
        pdop=fix["pdop"],
        hdop=fix["hdop"],
        vdop=fix["vdop"],
    )


def parse_imu(sample: dict[str, Any]) -> ImuSample:
    """Parse a sample of an inertial unit; axes there are left-handed."""
    return ImuSample(
        specific_force=mirror_points([sample["accelerometer"][axis] for axis in "xyz"]),
        angular_rate=mirror_angular_rate([sample["gyroscope"][axis] for axis in "xyz"]),
        compass_rad=sample["compass"],
        time_s=sample.get("time_offset", 0.0),
        earlier=tuple(map(parse_imu, sample.get("earlier", ()))),
    )


def parse_can(signals: dict[str, Any]) -> CanSample:
    """Parse signals of a vehicle's bus."""
    return CanSample(
        wheel_speeds_m_s=np.array(signals["wheel_speeds_m_s"], dtype=np.float64),
        speed_m_s=signals["speed_m_s"],
        steering_wheel_rad=signals["steering_wheel_rad"],
        yaw_rate_rad_s=signals["yaw_rate_rad_s"],
        is_braking=signals["brake"],
        indicator=Indicator(signals["indicator"]),
        time_s=signals.get("time_offset", 0.0),
        earlier=tuple(map(parse_can, signals.get("earlier", ()))),
    )
