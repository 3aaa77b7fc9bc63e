"""Receivers, inertial units and buses in a dataset: they share a document of every frame."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from advercity.dataset.carla_frame import mirror_angular_rate, mirror_points
from advercity.dataset.plain_documents import to_plain
from advercity.dataset.sensor_files import SensorFiles
from advercity.sensors.measurements import (
    CanSample,
    GnssFix,
    GnssSolution,
    ImuSample,
    Indicator,
    SolutionQuality,
)

if TYPE_CHECKING:
    from advercity_dsl import Agent

    from advercity.dataset.formats import DatasetFormat


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


def _describe_gnss(fix: GnssFix) -> dict[str, Any]:
    """Describe a fix; a fast receiver's fixes since the last frame are in `earlier`."""
    earlier = [_describe_gnss(one) for one in fix.earlier]
    return {
        **({"earlier": earlier} if earlier else {}),
        # 1e-12 degrees are 0.1 micrometres; 1e-9 degrees would be 0.1 millimetres.
        "lat": to_plain(fix.latitude_deg, decimals=12),
        "lon": to_plain(fix.longitude_deg, decimals=12),
        "alt": to_plain(fix.altitude_m),
        "timestamp": to_plain(fix.time_s),
        **({} if fix.heading_rad is None else {"heading": to_plain(fix.heading_rad)}),
        **({} if fix.quality is None else _describe_quality(fix.quality)),
    }


def _describe_quality(quality: SolutionQuality) -> dict[str, Any]:
    return {
        "solution": quality.solution.value,
        "satellites": quality.satellites,
        "visible": quality.visible,
        "pdop": to_plain(quality.pdop),
        "hdop": to_plain(quality.hdop),
        "vdop": to_plain(quality.vdop),
    }


def _describe_imu(sample: ImuSample) -> dict[str, Any]:
    """Describe a sample; a fast unit's samples since the last frame are in `earlier`."""
    earlier = [_describe_imu(one) for one in sample.earlier]
    acceleration = to_plain(mirror_points(sample.specific_force))
    rate = to_plain(mirror_angular_rate(sample.angular_rate))
    return {
        **({"time_offset": to_plain(sample.time_s)} if sample.time_s else {}),
        **({"earlier": earlier} if earlier else {}),
        "accelerometer": dict(zip("xyz", acceleration, strict=True)),
        "gyroscope": dict(zip("xyz", rate, strict=True)),
        "compass": to_plain(sample.compass_rad),
    }


def _describe_can(sample: CanSample) -> dict[str, Any]:
    """Describe signals of a bus in its own convention: metres, radians, positive to the left."""
    earlier = [_describe_can(one) for one in sample.earlier]
    return {
        **({"time_offset": to_plain(sample.time_s)} if sample.time_s else {}),
        **({"earlier": earlier} if earlier else {}),
        "wheel_speeds_m_s": to_plain(sample.wheel_speeds_m_s),
        "speed_m_s": to_plain(sample.speed_m_s),
        "steering_wheel_rad": to_plain(sample.steering_wheel_rad),
        "yaw_rate_rad_s": to_plain(sample.yaw_rate_rad_s),
        "brake": sample.is_braking,
        "indicator": sample.indicator.value,
    }


def _list_receiver_suffixes(agent: Agent, number: int, layout: DatasetFormat) -> tuple[str, ...]:
    """List the document of every vehicle, and of units whose receiver has satellites."""
    is_vehicle = agent.place.kind == "vehicle"
    reports = is_vehicle or agent.sensors.gnss.mode == "satellites"
    return (layout.motion_suffix,) if reports else ()


def _list_suffixes(agent: Agent, number: int, layout: DatasetFormat) -> tuple[str, ...]:
    return (layout.motion_suffix,)


GNSS = SensorFiles(
    read=lambda view, number: view.motion[0],
    list_suffixes=_list_receiver_suffixes,
    report=lambda item, number: {"gnss": _describe_gnss(item.readings["gnss"][number])},
)
IMU = SensorFiles(
    read=lambda view, number: view.motion[1],
    list_suffixes=_list_suffixes,
    report=lambda item, number: {"imu": _describe_imu(item.readings["imu"][number])},
)
CAN = SensorFiles(
    read=lambda view, number: view.can,
    list_suffixes=_list_suffixes,
    report=lambda item, number: {"can": _describe_can(item.readings["can"][number])},
)
