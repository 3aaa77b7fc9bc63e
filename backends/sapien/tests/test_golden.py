"""Small pictures of every weather in both renderers, as they were made and looked at.

On the same device and processor, pictures are equal to the bit; elsewhere they are equal but for
rounding. After an intended visible change:

    python backends/sapien/tests/test_golden.py
"""

import json
from pathlib import Path
from typing import Literal, get_args

import cv2
import numpy as np
import pytest
from advercity_dsl import Camera, Mount, Weather
from advercity_dsl.weather_components import Sun
from advercity_sapien import SapienBackend
from numpy.typing import ArrayLike, NDArray

from advercity.compiler import find_weather, list_weathers
from advercity.frames import Actor, ActorState, Frame, Lamp, Signal
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.physics.atmosphere import compute_atmosphere
from advercity.pipeline.surface_maps import SurfaceMaps
from advercity.randomness import create_generator
from advercity.rendering.backend import CameraView, RenderProfile
from advercity.rendering.light_sources import list_light_sources
from advercity.semantics import Semantic
from advercity.sensors.camera import CameraConditions, CameraExposure, render_image
from advercity.traffic.weather_effects import apply_lamp_state
from advercity.world import Body, SignalLamp, StreetLamp, World
from tests.render_builders import PACKS

pytestmark = pytest.mark.render

Renderer = Literal["raster", "ray_traced"]
Image = NDArray[np.uint8]
GOLDEN = Path(__file__).parent / "golden"
ROOT = Path(__file__).parents[3]
EXAMPLES = ("snow_day", "snow_night", "dust_day")
WIDTH_PX, HEIGHT_PX = 96, 54
ACROSS = 4
NEAR_DN = 3.0
"""Mean difference allowed to other devices; noise alone makes about as much."""
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ],
    dtype=np.int32,
)


def box(
    middle: ArrayLike, size: ArrayLike, material: str, semantic: Semantic = Semantic.BUILDING
) -> Mesh:
    vertices = np.asarray(middle) + CORNERS * np.asarray(size) / 2.0
    name = f"box {middle}"
    return Mesh(name, vertices.astype(np.float32), FACES, material, semantic)


def street() -> World:
    """A straight street with a lane line, houses, trees, two lamps and a signal."""
    houses = [box((12.0 * n, 12.0, 3.0), (8.0, 6.0, 6.0), "brick") for n in range(1, 9)]
    trees = [
        box((9.0 * n, -8.0, 2.5), (2.0, 2.0, 3.0), "leaves", Semantic.VEGETATION)
        for n in range(1, 9)
    ]
    lines = [
        box((8.0 * n, 0.0, 0.005), (3.0, 0.15, 0.01), "paint_white", Semantic.ROAD_LINE)
        for n in range(12)
    ]
    return World(
        id="golden",
        static=(
            box((0.0, 0.0, -0.5), (400.0, 12.0, 1.0), "asphalt", Semantic.ROAD),
            box((0.0, 0.0, -0.6), (400.0, 400.0, 1.0), "grass", Semantic.TERRAIN),
            box((24.0, -5.5, 2.5), (0.2, 0.2, 5.0), "metal", Semantic.POLE),
            *(houses + trees + lines),
        ),
        bodies={"car": Body(car(), (4.4, 1.8, 1.5))},
        lanes=(),
        network=Path("none"),
        street_lamps=(StreetLamp((14.0, 5.5, 8.0)), StreetLamp((40.0, -5.5, 8.0))),
        signal_lamps=(SignalLamp("j/a", (24.0, -5.3, 4.0), (-1.0, 0.0)),),
        material_maps=SurfaceMaps(),
    )


def car() -> tuple[Mesh, ...]:
    vehicle = Semantic.VEHICLE
    return (
        box((0.0, 0.0, 0.6), (4.4, 1.8, 0.8), "paint", vehicle),
        box((-0.2, 0.0, 1.25), (2.2, 1.6, 0.5), "glass", vehicle),
        box((-2.21, 0.0, 0.7), (0.02, 1.6, 0.15), "lamp_red", vehicle),
        box((2.21, 0.0, 0.65), (0.02, 1.6, 0.15), "lamp_white", vehicle),
    )


def traffic() -> Frame:
    def driving(number: int, x: float, y: float, yaw: float, paint: str) -> ActorState:
        actor = Actor(number, "car", "car", paint, (4.4, 1.8, 1.5))
        lamps = Lamp.BRAKE if number == 1 else Lamp(0)
        return ActorState(actor, pose_matrix((x, y, 0.0), yaw=yaw), 11.0, 0.0, lamps)

    ahead = driving(1, 12.0, -1.8, 0.0, "car_paint_silver")
    oncoming = driving(2, 30.0, 1.8, np.pi, "car_paint_red")
    return Frame(7, 6.6, (ahead, oncoming), {"j/a": Signal.RED})


def weathers() -> dict[str, Weather]:
    examples = (ROOT / "library" / "examples" / f"{name}.yaml" for name in EXAMPLES)
    entries = [*list_weathers(), *(find_weather(str(path)) for path in examples)]
    return {item.declaration.id: at_the_street(item.declaration) for item in entries}


def at_the_street(weather: Weather) -> Weather:
    """The sun is over the end of the street if it should be in view."""
    ahead = Sun(elevation_deg=8, azimuth_deg=84)
    return weather.model_copy(update={"sun": ahead}) if weather.sun.in_view_of else weather


def taken(name: str, weather: Weather, renderer: Renderer) -> Image:
    profile = RenderProfile("golden", 1.0, renderer, samples=4, path_depth=2)
    world, frame = street(), apply_lamp_state(traffic(), weather.lamps)
    air = compute_atmosphere(weather, "urban")
    camera = Camera(mounts=(Mount(),))
    view = CameraView(pose_matrix((0.0, -1.8, 1.45)), WIDTH_PX, HEIGHT_PX, np.radians(100.0))
    with SapienBackend().open(world, air, profile) as opened:
        opened.place(frame)
        capture = opened.render_camera(view)
    lamps = tuple(list_light_sources(world, frame)) if air.night else ()
    shot = CameraExposure(view, camera, frame, np.array([11.0, 0.0, 0.0]), lamps)
    rng = create_generator("golden", name)
    return render_image(
        capture, shot, CameraConditions.build(air, weather.lens, "golden"), rng, mount=Mount()
    ).image


def device() -> str:
    """The properties two equal pictures must share to be the same to the bit."""
    processor = np.show_config(mode="dicts")["SIMD Extensions"]["found"]  # type: ignore[index]
    return f"{SapienBackend().capabilities().device}; NumPy {np.__version__} {processor}"


def cell(number: int) -> tuple[slice, slice]:
    row, column = divmod(number, ACROSS)
    top, left = row * HEIGHT_PX, column * WIDTH_PX
    return slice(top, top + HEIGHT_PX), slice(left, left + WIDTH_PX)


@pytest.mark.parametrize("renderer", PACKS)
def test_every_weather_looks_as_it_was_looked_at(renderer: Renderer) -> None:
    made_on = json.loads((GOLDEN / "made_on.json").read_text())
    sheet = cv2.imread(str(GOLDEN / f"{renderer}.png"))
    assert sheet is not None
    for number, (name, weather) in enumerate(weathers().items()):
        expected = sheet[cell(number)][..., ::-1].astype(int)
        difference = np.abs(taken(name, weather, renderer).astype(int) - expected)
        if device() == made_on[renderer]:
            assert difference.max() == 0, f"{name} changed; if it is meant to, {__doc__}"
        else:
            assert difference.mean() < NEAR_DN, f"{name}, made on {made_on[renderer]}"


def make() -> None:
    GOLDEN.mkdir(exist_ok=True)
    for renderer in get_args(Renderer):
        found = weathers()
        rows = -(-len(found) // ACROSS)
        sheet = np.zeros((rows * HEIGHT_PX, ACROSS * WIDTH_PX, 3), np.uint8)
        for number, (name, weather) in enumerate(found.items()):
            sheet[cell(number)] = taken(name, weather, renderer)[..., ::-1]
        cv2.imwrite(str(GOLDEN / f"{renderer}.png"), sheet, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    made_on = {renderer: device() for renderer in get_args(Renderer)}
    (GOLDEN / "made_on.json").write_text(json.dumps(made_on, indent=1) + "\n")


if __name__ == "__main__":
    make()
