"""Views of advercity's sensors in viewers."""

import numpy as np

from advercity.dataset.image_codec import to_semantic_colours
from advercity.run_options import CloudColour
from advercity.sensors.measurements import PointKind
from advercity.sensors.sensor_frame import SensorFrame
from advercity.viewer.cloud_colours import colour_points
from advercity.viewer.radar_pictures import colour_velocities, draw_range_azimuth
from advercity.viewer.shown import Curve, Picture, Place, Points, Shown
from advercity.viewer.thermal_pictures import draw_thermal

DETECTION_PX = 3.0
POINT_PX, ECHO_PX = 1.5, 0.5
"""Sizes on the screen; returns of fog, rain and spray are small, so the scene shows through."""


def show_camera(item: SensorFrame, number: int, colouring: CloudColour) -> tuple[Shown, ...]:
    """Show an image in the scene, and its classes next to it, where they do not cover the image."""
    image, name = item.camera_images[number], f"camera{number}"
    model, pose = item.build_camera_model(number), image.world_from_camera
    classes = to_semantic_colours(image.semantic)
    title = f"semantic {number}"
    return (
        Picture(name, f"camera {number}", image.image, pose, model),
        Picture(name, title, classes, group="semantic", is_label=True),
    )


def show_lidar(item: SensorFrame, number: int, colouring: CloudColour) -> tuple[Shown, ...]:
    """Show the points of a scan."""
    scan = item.lidar_scans[number]
    cloud = scan.point_cloud
    sizes_px = np.where(cloud.kind == PointKind.SURFACE, POINT_PX, ECHO_PX)
    colours = colour_points(cloud, colouring)
    name = f"lidar{number or ''}"
    return (Points(name, cloud.points, scan.world_from_lidar, colours, sizes_px),)


def show_radar(item: SensorFrame, number: int, colouring: CloudColour) -> tuple[Shown, ...]:
    """Show detections by their radial velocity, and powers over azimuth and range."""
    scan, name = item.radar_scans[number], f"radar{number}"
    colours = colour_velocities(scan.detections.velocity_m_s)
    powers = draw_range_azimuth(item.agent.sensors.radars[number].model, scan)
    return (
        Points(name, scan.detections.points, scan.world_from_radar, colours, DETECTION_PX),
        Picture(name, f"radar {number}", powers, group="range_azimuth"),
    )


def show_thermal(item: SensorFrame, number: int, colouring: CloudColour) -> tuple[Shown, ...]:
    """Show an image, white hot."""
    image = item.thermal_images[number]
    grey, model = draw_thermal(image.counts), item.build_thermal_model(number)
    title = f"thermal {number}"
    return (Picture(f"thermal{number}", title, grey, image.world_from_camera, model),)


def show_gnss(item: SensorFrame, number: int, colouring: CloudColour) -> tuple[Shown, ...]:
    """Show a fix on the map, and as curves."""
    fix = item.readings["gnss"][number]
    return (
        Place(fix.latitude_deg, fix.longitude_deg),
        Curve("latitude", fix.latitude_deg),
        Curve("longitude", fix.longitude_deg),
        Curve("altitude", fix.altitude_m),
    )


def show_imu(item: SensorFrame, number: int, colouring: CloudColour) -> tuple[Shown, ...]:
    """Show accelerations and turn rates as curves."""
    sample, axes = item.readings["imu"][number], ("ahead", "left", "up")
    return (
        Curve("acceleration", sample.specific_force, axes),
        Curve("turn_rate", sample.angular_rate, axes),
    )
