"""Shows what camera, LiDAR and radar make of the same moment in four weathers.

    python docs/make_sensor_pictures.py [FOLDER]

Writes `sensors_by_weather.md` to the parent of FOLDER (by default `docs/images`), and to FOLDER the
picture of that page: the ego's front camera, its LiDAR and its front radar from above, out of
datasets that are written for it. The page also has the ranges at which they detect road users.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from advercity_dsl import Spec
from detection_ranges import (
    PLACEMENT_STEP_M,
    PLACEMENTS,
    TARGETS,
    DetectionRanges,
    DetectionScene,
)
from numpy.typing import NDArray

import advercity
from advercity.compiler import find_weather, with_weather
from advercity.compiler.crossing import compile_library
from advercity.dataset.agent_view import AgentView
from advercity.geometry import poses
from advercity.geometry.poses import Matrix
from advercity.sensors.measurements import PointKind
from advercity.viewer.cloud_colours import KIND_COLOUR_TABLE
from advercity.viewer.radar_pictures import colour_velocities

ROOT = Path(__file__).parents[1]
SUITE, SPEC, FRAME = "radar", "ui_clear_day_dense", 50
WEATHERS = ("clear_day", "heavy_rain_day", "fog_day", str(ROOT / "library/examples/snow_day.yaml"))
HEIGHT_PX, AHEAD_M, BEHIND_M, SIDE_M = 360, 80.0, 10.0, 45.0
SCALE = 1 / 3
"""Of the pictures that are taken."""
BOX_COLOUR = (250, 200, 60)
GAP_PX = 4
NOTE = """\
One moment in clear air, 50 mm/h of rain, fog of 75 m and snow: the ego's front camera; its LiDAR,
coloured by what returned a point (grey: surfaces, blue: rain or fog, white: snow); its front radar,
coloured by velocity (blue comes closer, red moves away; what is not moving comes closer to a moving
ego). Boxes are the annotated road users.

Made by `python docs/make_sensor_pictures.py`.
"""
RIGS_NOTE = """\
The same moment through the first camera, LiDAR, radar and [thermal camera](thermal.md) of the rigs
that ship: three on the ego, `roadside` on a roadside unit. Grey: the rig has none. Clear air and
rain are above, fog and snow below.

Made by `python docs/make_rig_pictures.py`.
"""
RANGES_NOTE = f"""\
Ranges in metres up to which a target from behind is detected, alone on a level road: by the camera
at a contrast of 5 % before the lens, by the LiDAR with five points, by the radar with one
detection. More than 200 m were not tried. The LiDAR's 32 rings lie 1.3 degrees apart, 1.4 m at
60 m, and meet a car or miss it by centimetres: its range is a mean over {PLACEMENTS} placements
every {PLACEMENT_STEP_M} m, the same in all weathers, with its 95 % interval.
"""


def main() -> None:
    """Run the scene in every weather and write picture and page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", default=ROOT / "docs" / "images", type=Path)
    folder: Path = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    specs = compile_library(ROOT / "library", suite=SUITE)
    spec = next(spec for spec in specs if spec.id == SPEC)
    variants = [with_weather(spec, find_weather(name)) for name in WEATHERS]
    with TemporaryDirectory() as output:
        rows = [draw_row(run_frame(one, Path(output))) for one in variants]
    quality = [cv2.IMWRITE_JPEG_QUALITY, 88]
    cv2.imwrite(str(folder / "sensors_by_weather.jpg"), np.vstack(rows)[..., ::-1], quality)
    page = f"""\
# Sensors by weather

{NOTE}
![Camera, LiDAR and radar in four weathers](images/sensors_by_weather.jpg)

## Through four rigs

{RIGS_NOTE}
![Four rigs in four weathers](images/rigs_by_weather.jpg)

## How far they see

{RANGES_NOTE}
{format_ranges(list(measure_ranges(variants)))}"""
    (folder.parent / "sensors_by_weather.md").write_text(page)


def run_frame(spec: Spec, output: Path) -> AgentView:
    """Run one frame and open what the ego sensed."""
    frames = slice(FRAME, FRAME + 1)
    advercity.run(spec, output / spec.id, profile="preview", scale=SCALE, frames=frames)
    return advercity.open_dataset(output / spec.id)[0]["cav1"]


def draw_row(view: AgentView) -> NDArray[np.uint8]:
    """Draw camera, LiDAR and radar (h, w, 3), RGB, one next to the other."""
    image = view.image(0)
    width_px = HEIGHT_PX * image.shape[1] // image.shape[0]
    small = cv2.resize(image, (width_px, HEIGHT_PX), interpolation=cv2.INTER_AREA)
    gap = np.full((HEIGHT_PX, GAP_PX, 3), 255, np.uint8)
    return np.hstack([small.astype(np.uint8), gap, draw_lidar(view), gap, draw_radar(view)])


def draw_lidar(view: AgentView) -> NDArray[np.uint8]:
    """Draw the points from above, coloured by kind; airborne ones first."""
    cloud = view.cloud
    order = np.argsort(cloud["kind"] == PointKind.SURFACE, kind="stable")
    points = _stack_xyz(cloud)[order]
    return _draw_view(
        view, view.world_from_lidar, points, KIND_COLOUR_TABLE[cloud["kind"][order]], 0
    )


def draw_radar(view: AgentView) -> NDArray[np.uint8]:
    """Draw the detections from above, coloured by velocity; those of the air by kind."""
    found = view.radar
    colours = colour_velocities(found["velocity"])
    return _draw_view(view, view.load_radar_pose(0), _stack_xyz(found), colours, 2)


def _stack_xyz(table: NDArray[np.void]) -> NDArray[np.float64]:
    return np.column_stack([table[name] for name in "xyz"]).astype(np.float64)


def _draw_view(
    view: AgentView,
    world_from_sensor: Matrix,
    points: NDArray[np.float64],
    colours: NDArray[np.uint8],
    radius_px: int,
) -> NDArray[np.uint8]:
    agent_from_world = poses.invert_pose(view.world_from_agent)
    boxes = list(zip(view.boxes.world_from_box, view.boxes.sizes, strict=True))
    return draw_from_above(agent_from_world, boxes, world_from_sensor, points, colours, radius_px)


def draw_from_above(
    agent_from_world: Matrix,
    boxes: Sequence[tuple[Matrix, NDArray[np.float64]]],
    world_from_sensor: Matrix,
    points: NDArray[np.float64],
    colours: NDArray[np.uint8],
    radius_px: int,
) -> NDArray[np.uint8]:
    """Draw points (n, 3) of a sensor and boxes of road users, poses and sizes; ahead is up."""
    picture = np.full((HEIGHT_PX, HEIGHT_PX, 3), 16, np.uint8)
    for place, colour in zip(
        _to_pixels(agent_from_world @ world_from_sensor, points), colours.tolist(), strict=True
    ):
        cv2.circle(picture, place, radius_px, colour, cv2.FILLED)
    corners = np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]]) / 2
    for world_from_box, size in boxes:
        outline = _to_pixels(agent_from_world @ world_from_box, corners * size)
        cv2.polylines(picture, [np.array(outline)], isClosed=True, color=BOX_COLOUR)
    return picture


def _to_pixels(agent_from_points: Matrix, points: NDArray[np.float64]) -> list[tuple[int, int]]:
    x, y, _ = agent_from_points[:3, :3] @ points.T + agent_from_points[:3, 3:]
    scale = HEIGHT_PX / (AHEAD_M + BEHIND_M)
    columns, rows = np.rint((SIDE_M - y) * scale), np.rint((AHEAD_M - x) * scale)
    return list(zip(columns.astype(int).tolist(), rows.astype(int).tolist(), strict=True))


def measure_ranges(variants: Sequence[Spec]) -> Iterator[tuple[str, str, DetectionRanges]]:
    """Yield weather, target and ranges."""
    for target in TARGETS:
        scene = DetectionScene(variants[0], variants[0].agents[0], target)
        for spec in variants:
            yield spec.weather.id, target.name, scene.find_ranges(spec.weather)


def format_ranges(rows: Sequence[tuple[str, str, DetectionRanges]]) -> str:
    """Format ranges in Markdown."""
    lines = ["| weather | target | camera | LiDAR | radar |", "|---|---|---|---|---|"]
    for weather, target, ranges in rows:
        cells = (ranges.camera_m, ranges.lidar, ranges.radar_m)
        lines.append(f"| {weather} | {target} | " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
