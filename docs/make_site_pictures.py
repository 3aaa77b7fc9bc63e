"""Renders the images of the five sites in `docs/images/sites/`.

    python docs/make_site_pictures.py [FOLDER [ROAD ...]]

Four images per road: from the ego's front camera, from both roadside units and from 60 m above, on
a clear day in sparse traffic. `rsnj_seasons` has three seasons one above the other, from the ego.
"""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from advercity_dsl import Spec
from advercity_dsl.road import Season
from numpy.typing import NDArray

from advercity.compiler.crossing import compile_library
from advercity.geometry.poses import Matrix, pose_matrix
from advercity.physics.atmosphere import compute_atmosphere
from advercity.pipeline.preparation import load_or_build_world, load_or_simulate_traffic
from advercity.rendering.backend import CameraView, RenderProfile, load_backend
from advercity.sensors.agent_poses import AgentPoses
from advercity.sensors.camera import CameraConditions, CameraExposure, render_image

ROOT = Path(__file__).parents[1]
WIDTH_PX, HEIGHT_PX = 960, 540
MAX_BYTES = 120_000
FRAMES = {"ui": 40, "unj": 45, "ri": 30, "rsnj": 50, "rcnj": 60}
ABOVE_M = 60.0
SEASONS_ROAD = "rsnj"
SKY_PX = 180
"""Rows of sky that pictures of seasons leave out."""


def main() -> None:
    """Render the images of the named roads, or of all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "docs/images/sites")
    parser.add_argument("roads", nargs="*", default=list(FRAMES))
    options = parser.parse_args()
    specs = {spec.id: spec for spec in compile_library(ROOT / "library")}
    options.folder.mkdir(parents=True, exist_ok=True)
    for road in options.roads:
        for name, image in render_views(specs[f"{road}_clear_day_sparse"], FRAMES[road]):
            (options.folder / f"{road}_{name}.jpg").write_bytes(encode_jpeg(image))
    if SEASONS_ROAD in options.roads:
        image = render_seasons(specs[f"{SEASONS_ROAD}_clear_day_sparse"], FRAMES[SEASONS_ROAD])
        (options.folder / f"{SEASONS_ROAD}_seasons.jpg").write_bytes(encode_jpeg(image))


def render_seasons(spec: Spec, index: int) -> NDArray[np.uint8]:
    """Render what the ego's front camera sees in each season, as (h, w, 3) one above the other."""
    images: list[NDArray[np.uint8]] = []
    for season in Season:
        road = spec.road.model_copy(update={"season": season})
        views = dict(render_views(spec.model_copy(update={"road": road}), index))
        images.append(views["ego"][SKY_PX:])
    return np.concatenate(images)


def render_views(spec: Spec, index: int) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Yield the name and the sRGB image (h, w, 3) of each view of a scenario at frame `index`."""
    stage = load_or_simulate_traffic(spec)
    viewpoints = AgentPoses(spec, stage.trace)
    frame = viewpoints.load_frame(index)
    atmosphere = compute_atmosphere(spec.weather, spec.road.land_use)
    air = CameraConditions.build(atmosphere, spec.weather.lens, spec.seeds.sensors, spec.id)
    profile = RenderProfile("pictures", 1.0, "raster")
    world = load_or_build_world(spec, stage.network_path)
    with load_backend("sapien").open(world, atmosphere, profile) as renderer:
        renderer.place(frame)
        for name, world_from_camera, hide in _list_views(viewpoints, index):
            camera = spec.agents[0].sensors.cameras[0].model
            view = CameraView(
                world_from_camera,
                WIDTH_PX,
                HEIGHT_PX,
                math.radians(camera.horizontal_fov_deg),
                hide=hide,
            )
            exposure = CameraExposure(view, camera, frame, velocity=np.zeros(3))
            rng = viewpoints.make_generator("picture", spec.agents[0], frame)
            capture = renderer.render_camera(view)
            yield name, render_image(capture, exposure, air, rng, mount=camera.mounts[0]).image


def _list_views(viewpoints: AgentPoses, index: int) -> Iterator[tuple[str, Matrix, frozenset[int]]]:
    agents = {agent.id: agent for agent in viewpoints.spec.agents}
    ego, frame = agents["cav1"], viewpoints.load_frame(index)
    yield "ego", viewpoints.world_from_sensors("camera", ego, frame)[0], frozenset({ego.number})
    for name in ("rsu1", "rsu2"):
        yield name, viewpoints.world_from_sensors("camera", agents[name], frame)[0], frozenset()
    yield "above", _build_aerial_pose(viewpoints.world_from_agent(ego, index)), frozenset()


def _build_aerial_pose(world_from_ego: Matrix) -> Matrix:
    """Build a camera pose behind the ego and `ABOVE_M` over it that looks down ahead of it."""
    yaw = math.atan2(world_from_ego[1, 0], world_from_ego[0, 0])
    x, y, z, _ = world_from_ego @ (-45.0, 0.0, ABOVE_M, 1.0)
    return pose_matrix((x, y, z), yaw=yaw, pitch=math.radians(38.0))


def encode_jpeg(image: NDArray[np.uint8]) -> bytes:
    """Encode an sRGB image (h, w, 3) as JPEG in the best quality that fits `MAX_BYTES`."""
    for quality in range(90, 30, -5):
        _, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
        if len(data) <= MAX_BYTES:
            return data.tobytes()
    raise AssertionError("an image of noise")


if __name__ == "__main__":
    main()
