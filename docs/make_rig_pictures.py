"""Shows one moment through the four rigs that ship, in four weathers.

    python docs/make_rig_pictures.py [FOLDER]

Writes `rigs_by_weather.jpg` to FOLDER (by default `docs/images`) for `docs/sensors_by_weather.md`:
the first camera, LiDAR, radar and thermal camera of each rig, in clear air, rain, fog and snow.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from advercity_dsl import Agent, Rig, Spec
from make_sensor_pictures import ROOT, WEATHERS, draw_from_above
from numpy.typing import NDArray

from advercity.compiler import find_weather, load_library, with_weather
from advercity.compiler.crossing import compile_library
from advercity.geometry import poses
from advercity.geometry.poses import Matrix
from advercity.pipeline import RunOptions
from advercity.pipeline.preparation import prepare_scenario
from advercity.pipeline.sensing import SensorRig
from advercity.sensors.annotation import annotate_actors
from advercity.sensors.measurements import PointKind
from advercity.sensors.messages import to_level_pose
from advercity.sensors.sensor_frame import SensorFrame
from advercity.viewer.cloud_colours import KIND_COLOUR_TABLE
from advercity.viewer.radar_pictures import colour_velocities
from advercity.viewer.thermal_pictures import draw_thermal

SPEC, FRAME = "ui_clear_day_dense", 50
CARRIERS = {"adver_city": 0, "nuscenes_like": 0, "robotaxi": 0, "roadside": -2}
"""Index among the agents of the one that carries a rig: the ego, or the first roadside unit."""
SCALE, HEIGHT_PX, GAP_PX = 1 / 3, 180, 3
WIDTHS_PX = 320, 180, 180, 225


def main() -> None:
    """Capture the moment in every weather and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", default=ROOT / "docs" / "images", type=Path)
    folder: Path = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    specs = compile_library(ROOT / "library", suite="adver_city")
    spec = next(spec for spec in specs if spec.id == SPEC)
    blocks = [draw_weather(with_weather(spec, find_weather(name))) for name in WEATHERS]
    picture = np.vstack([np.hstack(blocks[:2]), np.hstack(blocks[2:])])
    quality = [cv2.IMWRITE_JPEG_QUALITY, 88]
    cv2.imwrite(str(folder / "rigs_by_weather.jpg"), picture[..., ::-1], quality)


def with_rigs(spec: Spec) -> Spec:
    """Return the scenario with an agent for each rig, of which several are in one place."""
    rigs = load_library(ROOT / "library").get_declarations(Rig)
    agents = [equip(spec.agents[at], rigs[rig]) for rig, at in CARRIERS.items()]
    return spec.model_copy(update={"agents": tuple(agents)})


def equip(agent: Agent, rig: Rig) -> Agent:
    """Return an agent, named after a rig, with the first of its sensors of each kind."""
    declared = rig.vehicle if agent.place.kind == "vehicle" else rig.roadside_unit
    assert declared is not None
    kinds = {
        name: kind.model_copy(update={"mounts": kind.mounts[:1]})
        for name in ("camera", "radar", "thermal")
        if (kind := getattr(declared, name)) is not None
    }
    sensors = declared.model_copy(update={**kinds, "more_cameras": {}, "more_lidars": {}})
    return agent.model_copy(update={"id": rig.id, "sensors": sensors})


def draw_weather(spec: Spec) -> NDArray[np.uint8]:
    """Draw a row for every rig in the weather of the scenario."""
    frames = slice(FRAME, FRAME + 1)
    options = RunOptions(output=Path("none"), profile="preview", scale=SCALE, frames=frames)
    prepared = prepare_scenario(spec, options)
    world = prepared.load_world()
    air = prepared.poses.timeline.atmosphere_at(FRAME, spec.road.land_use)
    with prepared.backend.open(world, air, prepared.profile) as renderer:
        equipped = replace(prepared, spec=with_rigs(spec))
        sensors = SensorRig(equipped, renderer, world)
        rows = [draw_row(item, spec.weather.id) for item in sensors.capture_frame(FRAME)]
    return np.vstack(rows)


def draw_row(item: SensorFrame, weather: str) -> NDArray[np.uint8]:
    """Draw camera, LiDAR, radar and thermal camera; those that a rig lacks are grey."""
    found = (
        item.camera_images[0].image,
        draw_lidar(item),
        draw_radar(item) if item.radar_scans else None,
        draw_thermal(item.thermal_images[0].counts) if item.thermal_images else None,
    )
    cells = [fit_cell(image, width) for image, width in zip(found, WIDTHS_PX, strict=True)]
    write_label(cells[0], f"{item.agent.id}, {weather}")
    return np.hstack(cells)


def fit_cell(image: NDArray[np.uint8] | None, width_px: int) -> NDArray[np.uint8]:
    """Fit the middle of an image (h, w, 3) into a cell with a gap to the right and below."""
    cell = np.full((HEIGHT_PX + GAP_PX, width_px + GAP_PX, 3), 255, np.uint8)
    if image is None:
        cell[:HEIGHT_PX, :width_px] = 225
        return cell
    height, width = image.shape[:2]
    ratio = max(HEIGHT_PX / height, width_px / width)
    size = max(width_px, round(width * ratio)), max(HEIGHT_PX, round(height * ratio))
    resized = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    left, top = (size[0] - width_px) // 2, (size[1] - HEIGHT_PX) // 2
    cell[:HEIGHT_PX, :width_px] = resized[top : top + HEIGHT_PX, left : left + width_px]
    return cell


def write_label(cell: NDArray[np.uint8], text: str) -> None:
    """Write a text into the lower left corner of a cell."""
    font, size = cv2.FONT_HERSHEY_SIMPLEX, 0.42
    (width, height), below = cv2.getTextSize(text, font, size, 1)
    top = HEIGHT_PX - height - below - 4
    cell[top:HEIGHT_PX, : width + 8] = 20
    place = 4, HEIGHT_PX - below - 1
    cv2.putText(cell, text, place, font, size, (255, 255, 255), 1, cv2.LINE_AA)


def draw_lidar(item: SensorFrame) -> NDArray[np.uint8]:
    """Draw the points from above, coloured by kind; airborne ones first."""
    cloud = item.point_cloud
    order = np.argsort(cloud.kind == PointKind.SURFACE, kind="stable")
    return draw_top(
        item, item.world_from_lidar, cloud.points[order], KIND_COLOUR_TABLE[cloud.kind[order]], 0
    )


def draw_radar(item: SensorFrame) -> NDArray[np.uint8]:
    """Draw the detections from above, coloured by velocity."""
    scan = item.radar_scans[0]
    colours = colour_velocities(scan.detections.velocity_m_s)
    return draw_top(item, scan.world_from_radar, scan.detections.points, colours, 2)


def draw_top(
    item: SensorFrame,
    world_from_sensor: Matrix,
    points: NDArray[np.float32],
    colours: NDArray[np.uint8],
    radius_px: int,
) -> NDArray[np.uint8]:
    """Draw points (n, 3) of a sensor and the annotated road users, ahead of the agent up."""
    boxes = [
        (one.state.world_from_body @ poses.pose_matrix(one.state.box.centre), one.state.box.size)
        for one in annotate_actors(item)
    ]
    return draw_from_above(
        poses.invert_pose(to_level_pose(item.world_from_agent)),
        [(pose, np.array(size)) for pose, size in boxes],
        world_from_sensor,
        points.astype(np.float64),
        colours,
        radius_px,
    )


if __name__ == "__main__":
    main()
