"""Light and fog against Mitsuba's path tracers, where Mitsuba is installed."""

import math
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from advercity_dsl import Weather
from advercity_sapien import SapienBackend
from numpy.typing import NDArray

from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.materials import CONCRETE_77GHZ, MATERIALS, Material
from advercity.physics.atmosphere import Atmosphere, compute_atmosphere
from advercity.physics.extinction import AirExtinction
from advercity.physics.lamp_beams import LOW_BEAM
from advercity.physics.sky import (
    cie_relative_luminance,
    cie_sky_type,
    daylight_for_weather,
    direction_from_elevation_azimuth,
)
from advercity.physics.weather_parts.part import Extinction, Suspension
from advercity.rendering.backend import CameraView, RenderProfile
from advercity.rendering.fog_beams import compute_fog_beams
from advercity.rendering.light_sources import LAMP_BODY_CLEARANCE_M
from advercity.semantics import Semantic
from advercity.world import Body, StreetLamp, World
from tests.render_builders import (
    BOX_CORNERS,
    BOX_TRIANGLES,
    build_clear_air,
)

HINT = "light and fog are not compared with Mitsuba; `scripts/setup_peers` installs it"
mitsuba: Any = pytest.importorskip("mitsuba", reason=HINT)

pytestmark = pytest.mark.render

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
SIZE = 40, 30
EYE, TARGET = (0.0, 0.0, 1.5), (10.0, 0.0, 1.5)
SUN = np.array([-0.6, 0.0, 0.8])
ALBEDO = {"asphalt": 0.0, "gravel": 0.1, "brick": 0.5, "concrete": 0.4, "plaster": 0.8}
Triple = tuple[float, float, float]
Solid = tuple[Triple, Triple, str]
GROUND: Solid = (0.0, 0.0, -0.5), (400.0, 400.0, 1.0), "concrete"
WALL: Solid = (13.0, 1.0, 2.0), (2.0, 6.0, 4.0), "plaster"
BOX: Solid = (7.0, -2.0, 0.75), (1.5, 1.5, 1.5), "plaster"


@pytest.fixture(autouse=True)
def scalar_variant() -> None:
    """The backend with Mitsuba activates another one in the process.

    There other paths happen to meet a lamp, of which a single one outshines a reference.
    """
    mitsuba.set_variant("scalar_rgb")


@pytest.fixture(autouse=True)
def ideal_surfaces(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, albedo in ALBEDO.items():
        texture = MATERIALS[name].texture if name == "asphalt" else MATERIALS["glass"].texture
        ideal = Material(
            (albedo, albedo, albedo), 0.5, CONCRETE_77GHZ, roughness=1.0, texture=texture
        )
        monkeypatch.setitem(MATERIALS, name, ideal)


def air_of(**more: Any) -> Atmosphere:
    """A vacuum at night."""
    return build_clear_air(**({"night": True} | more))


def fog_air(extinction_per_m: float) -> AirExtinction:
    return AirExtinction((Suspension("fog", Extinction(at_550nm=extinction_per_m)),))


def lit_by_sky(luminance: float, **more: Any) -> Atmosphere:
    sky = np.full((6, 8, 8, 3), luminance, dtype=np.float32)
    return air_of(night=False, sky=sky, sky_lx=math.pi * luminance, **more)


def ours(
    air: Atmosphere,
    *solids: Solid,
    lamps: tuple[StreetLamp, ...] = (),
    car: tuple[Body, ActorState] | None = None,
    pack: Literal["raster", "ray_traced"] = "ray_traced",
    size: tuple[int, int] = SIZE,
) -> NDArray[Any]:
    """Luminance (h, w) by one of the packs."""
    meshes = tuple(
        Mesh(
            f"{middle}",
            (np.asarray(middle) + BOX_CORNERS * np.asarray(size) / 2.0).astype(np.float32),
            BOX_TRIANGLES,
            material,
            # Only surfaces of this class cast no shadows of lamps.
            Semantic.ROAD if size[:2] == GROUND[1][:2] else Semantic.BUILDING,
        )
        for middle, size, material in solids
    )
    bodies, states = ({}, ()) if car is None else ({"car": car[0]}, (car[1],))
    world = World("test", meshes, bodies, lanes=(), network=Path("none"), street_lamps=lamps)
    profile = RenderProfile("test", 1.0, pack, samples=96, path_depth=5)
    with SapienBackend().open(world, air, profile) as renderer:
        renderer.place(Frame(0, 0.0, states, {}))
        view = CameraView(pose_matrix(EYE), *size, math.radians(90.0))
        return renderer.render_camera(view).radiance @ LUMINANCE


def theirs(
    scene: dict[str, Any], *solids: Solid, integrator: dict[str, Any], samples: int = 128
) -> NDArray[Any]:
    """Radiance (h, w) by Mitsuba; the scene may define the material `asphalt`."""
    place = mitsuba.ScalarTransform4f
    bsdfs = {
        name: {"type": "diffuse", "reflectance": {"type": "rgb", "value": [albedo] * 3}}
        for name, albedo in ALBEDO.items()
    } | scene.pop("bsdfs", {})
    medium = scene.get("fog")
    sensor: dict[str, Any] = {
        "type": "perspective",
        "fov": 90.0,
        "to_world": place().look_at(origin=EYE, target=TARGET, up=[0, 0, 1]),
        "film": {
            "type": "hdrfilm",
            "width": SIZE[0],
            "height": SIZE[1],
            "pixel_format": "luminance",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent", "sample_count": samples},
    }
    if medium is not None:
        sensor["medium"] = {"type": "ref", "id": "fog"}
    shapes = {
        f"solid{number}": {
            "type": "cube",
            "to_world": place()
            .translate(np.asarray(middle).tolist())
            .scale((np.asarray(size) / 2.0).tolist()),
            "bsdf": bsdfs[material],
        }
        | ({} if medium is None else {"exterior": {"type": "ref", "id": "fog"}})
        for number, (middle, size, material) in enumerate(solids)
    }
    described = {"type": "scene", "integrator": integrator} | scene | shapes | {"sensor": sensor}
    return np.asarray(mitsuba.render(mitsuba.load_dict(described)))[..., 0]


def grey(value: float) -> dict[str, Any]:
    return {"type": "rgb", "value": [value] * 3}


def sun_and_sky(sun_lx: float, luminance: float) -> dict[str, Any]:
    return {
        "sky": {"type": "constant", "radiance": grey(luminance)},
        "sun": {"type": "directional", "direction": list(-SUN), "irradiance": grey(sun_lx)},
    }


PATHS = {"type": "path", "max_depth": 8}
VOLUME_PATHS = {"type": "volpath", "max_depth": 48, "rr_depth": 24}
BEAM = math.radians(80.0)


def fog_of(extinction: float) -> dict[str, Any]:
    """Droplets of 12 µm (Jendersie and d'Eon 2023): a narrow lobe by formula, a wide by table."""
    cosine, g, a = np.linspace(-1.0, 1.0, 401), 0.566864, 23.3775
    wide = (1.0 - g * g) / (1.0 + g * g - 2.0 * g * cosine) ** 1.5 / (4.0 * math.pi)
    wide *= (1.0 + a * cosine**2) / (1.0 + a * (1.0 + 2.0 * g * g) / 3.0)
    phase = {
        "type": "blendphase",
        "weight": 0.487418,
        "narrow": {"type": "hg", "g": 0.990455},
        "wide": {"type": "tabphase", "values": ",".join(f"{value:.6g}" for value in wide)},
    }
    fog = {"type": "homogeneous", "albedo": 1.0, "sigma_t": extinction, "phase": phase}
    return {"fog": fog}


def test_a_diffuse_scene_without_weather_is_as_bright_as_mitsubas() -> None:
    solids = GROUND, WALL, BOX
    found = ours(lit_by_sky(2000.0, sun_lx=20_000.0), *solids)
    expected = theirs(sun_and_sky(20_000.0, 2000.0), *solids, integrator=PATHS)
    assert found.mean() == pytest.approx(expected.mean(), rel=0.02)
    np.testing.assert_allclose(_blocks(found), _blocks(expected), rtol=0.05)


def test_a_flooded_road_mirrors_as_mitsubas_coated_plastic() -> None:
    road = (0.0, 0.0, -0.5), (400.0, 400.0, 1.0), "asphalt"
    solids = road, WALL, BOX
    # Hardly any wetness: walls stay dry.
    air = lit_by_sky(500.0, sun_lx=20_000.0, wetness=1e-3, puddle_coverage=1.0)
    flooded = {
        "type": "roughplastic",
        "distribution": "ggx",
        "alpha": 0.02,
        "int_ior": 1.333,
        "diffuse_reflectance": grey(0.0),
    }
    scene = sun_and_sky(20_000.0, 500.0) | {"bsdfs": {"asphalt": flooded}}
    found = ours(air, *solids)
    expected = theirs(scene, *solids, integrator=PATHS, samples=512)
    below = slice(SIZE[1] // 2, None)
    assert found[below].mean() == pytest.approx(expected[below].mean(), rel=0.05)


FIELD: Solid = (0.0, 0.0, -0.5), (5800.0, 5800.0, 1.0), "gravel"
HUTS: tuple[Solid, ...] = (
    ((7.0, -2.0, 0.75), (1.5, 1.5, 1.5), "brick"),
    ((15.0, 3.0, 1.25), (2.0, 3.0, 2.5), "brick"),
    ((30.0, -10.0, 3.0), (4.0, 6.0, 6.0), "brick"),
    ((45.0, 15.0, 4.0), (4.0, 8.0, 8.0), "brick"),
)
BANK_M = 100.0


def foggy_day(*, mor_m: float, oktas: int, elevation_deg: float, azimuth_deg: float) -> Weather:
    return Weather.model_validate(
        {
            "id": "fog",
            "time": "day",
            "air": {"mor_m": None},
            "fog": {"mor_m": mor_m, "depth_m": BANK_M},
            "sun": {"elevation_deg": elevation_deg, "azimuth_deg": azimuth_deg},
            "sky": {"oktas": oktas},
        }
    )


def above_fog(weather: Weather) -> dict[str, Any]:
    """Sky and sun as a picture of all directions, the sun two degrees wide to be found."""
    high, wide, radius = 360, 720, math.radians(2.0)
    polar = (np.arange(high) + 0.5) / high * math.pi
    turn = (np.arange(wide) + 0.5) / wide * 2.0 * math.pi
    theta, phi = np.meshgrid(polar, turn, indexing="ij")
    level = np.sin(theta)
    rays = np.stack([np.sin(phi) * level, np.cos(phi) * level, np.cos(theta)], axis=-1)
    solid_angle = level * (math.pi / high) ** 2
    light = daylight_for_weather(weather)
    sun = direction_from_elevation_azimuth(weather.sun.elevation_deg, weather.sun.azimuth_deg)
    sky = cie_relative_luminance(rays, sun, cie_sky_type(weather.sky.oktas)) * (rays[..., 2] > 0.0)
    sky *= light.diffuse_lx / np.sum(sky * np.maximum(rays[..., 2], 0.0) * solid_angle)
    disc = rays @ sun > math.cos(radius)
    sky += disc * light.direct_lx / np.sum(disc * solid_angle)
    picture = mitsuba.Bitmap(np.repeat(sky[..., None], 3, axis=-1).astype(np.float32))
    upright = mitsuba.ScalarTransform4f().rotate([1, 0, 0], 90)
    return {"sky": {"type": "envmap", "bitmap": picture, "to_world": upright}}


@pytest.mark.parametrize(
    ("mor_m", "oktas", "elevation_deg", "azimuth_deg"),
    [(75.0, 8, 60.0, 180.0), (150.0, 0, 40.0, 150.0)],
    ids=["overcast", "the sun through fog"],
)
def test_a_foggy_day_is_as_bright_as_mitsubas(
    mor_m: float, oktas: int, elevation_deg: float, azimuth_deg: float
) -> None:
    """Light from above a bank of fog, scattered in it hundreds of times."""
    weather = foggy_day(
        mor_m=mor_m, oktas=oktas, elevation_deg=elevation_deg, azimuth_deg=azimuth_deg
    )
    place = mitsuba.ScalarTransform4f
    bank = {
        "type": "cube",
        "to_world": place()
        .translate([0.0, 0.0, BANK_M / 2.0 - 0.5])
        .scale([3000.0, 3000.0, BANK_M / 2.0 + 0.5]),
        "bsdf": {"type": "null"},
        "interior": {"type": "ref", "id": "fog"},
    }
    scene = fog_of(math.log(20.0) / mor_m) | above_fog(weather) | {"bank": bank}
    integrator = {"type": "volpath", "max_depth": 256, "rr_depth": 40}
    expected = theirs(scene, FIELD, *HUTS, integrator=integrator, samples=400)
    for pack in ("ray_traced", "raster"):
        found = ours(compute_atmosphere(weather, "rural"), FIELD, *HUTS, pack=pack)
        assert found.mean() == pytest.approx(expected.mean(), rel=0.05), pack


LAMP_AT = (4.0, 3.0, 6.0)


@pytest.mark.parametrize("mor_m", [1000.0, 300.0])
def test_a_lamp_in_fog_is_as_bright_as_mitsubas(mor_m: float) -> None:
    extinction, flux_lm = math.log(20.0) / mor_m, 8000.0
    lamp = StreetLamp(LAMP_AT, flux_lm)
    found = ours(
        air_of(extinction=fog_air(extinction)),
        GROUND,
        WALL,
        BOX,
        lamps=(lamp,),
    )
    place = mitsuba.ScalarTransform4f
    up_to = 1024
    along = np.tan(BEAM) * ((np.arange(up_to) + 0.5) / up_to * 2.0 - 1.0)
    cosine = 1.0 / np.sqrt(1.0 + along[:, None] ** 2 + along[None] ** 2)
    scene = fog_of(extinction) | {
        "lamp": {
            "type": "spot",
            "to_world": place().look_at(
                origin=LAMP_AT, target=[LAMP_AT[0], LAMP_AT[1], 0.0], up=[1, 0, 0]
            ),
            "intensity": grey(flux_lm / math.pi),
            "cutoff_angle": math.degrees(BEAM),
            "beam_width": math.degrees(BEAM) - 0.1,
            "texture": {
                "type": "bitmap",
                "data": mitsuba.TensorXf(cosine[..., None].astype(np.float32)),
                "raw": True,
            },
            "medium": {"type": "ref", "id": "fog"},
        }
    }
    expected = theirs(scene, GROUND, WALL, BOX, integrator=VOLUME_PATHS, samples=400)
    assert found.mean() == pytest.approx(expected.mean(), rel=0.05)


YARD: tuple[Solid, ...] = (
    GROUND,
    ((18.0, 1.0, 1.5), (1.0, 30.0, 3.0), "plaster"),
    ((9.0, -12.0, 1.5), (6.0, 2.0, 3.0), "plaster"),
)
BEAMS_AT, BEAM_CD, HALF_TRACK_M = (9.0, 10.0, 0.65), 20e3, 0.63
FOG_FREE_M = 0.6
"""Around each lamp, where its light is so dense: a path tracer takes hours to resolve it."""
OPENING = math.radians(42.0)


def crossing_car() -> tuple[Body, ActorState]:
    """A body below the ground, whose dipped beams cross the picture from left to right."""
    size = (4.0, 1.8, 1.5)
    hidden = Mesh(
        "car",
        (BOX_CORNERS * 0.1 - [0, 0, 3]).astype(np.float32),
        BOX_TRIANGLES,
        "concrete",
        Semantic.VEHICLE,
    )
    at = BEAMS_AT[0], BEAMS_AT[1] + size[0] / 2.0 + LAMP_BODY_CLEARANCE_M, 0.0
    actor = Actor(1, "car", "car", "concrete", size)
    state = ActorState(actor, pose_matrix(at, yaw=-math.pi / 2.0), 0.0, 0.0, Lamp.LOW_BEAM)
    return Body((hidden,), size), state


def mitsubas_beams() -> dict[str, Any]:
    """Spot lamps with our pattern, each in a bubble without fog."""
    place, up_to = mitsuba.ScalarTransform4f, 2048
    along = np.tan(OPENING) * ((np.arange(up_to) + 0.5) / up_to * 2.0 - 1.0)
    left, up = np.meshgrid(along, along)
    rays = np.stack([np.ones_like(left), left, up], axis=-1).reshape(1, -1, 3)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    share = LOW_BEAM.relative_intensity(np.array([[1.0, 0.0, 0.0]]), rays).reshape(up_to, up_to, 1)
    pattern = mitsuba.TensorXf(share.astype(np.float32))
    found: dict[str, Any] = {}
    for side in (-1, 1):
        at = [BEAMS_AT[0] + side * HALF_TRACK_M, *BEAMS_AT[1:]]
        found[f"lamp_{side + 1}"] = {
            "type": "spot",
            "to_world": place().look_at(origin=at, target=[at[0], 0.0, at[2]], up=[0, 0, 1]),
            "intensity": grey(BEAM_CD),
            "cutoff_angle": math.degrees(OPENING),
            "beam_width": math.degrees(OPENING) - 0.1,
            "texture": {"type": "bitmap", "data": pattern, "raw": True},
        }
        found[f"bubble_{side + 1}"] = {
            "type": "sphere",
            "center": at,
            "radius": FOG_FREE_M,
            "bsdf": {"type": "null"},
            "exterior": {"type": "ref", "id": "fog"},
        }
    return found


def test_beams_in_fog_are_as_bright_as_mitsubas(monkeypatch: pytest.MonkeyPatch) -> None:
    """Light scattered by fog out of beams lights road and walls outside of them."""
    monkeypatch.setattr("advercity.rendering.light_sources.TAIL_CD", 0.0)
    by_concrete = partial(compute_fog_beams, ground_albedo=ALBEDO["concrete"])
    monkeypatch.setattr("advercity_sapien.renderer.compute_fog_beams", by_concrete)
    extinction = math.log(20.0) / 300.0
    scene = fog_of(extinction) | mitsubas_beams()
    expected = theirs(scene, *YARD, integrator=VOLUME_PATHS, samples=200)
    found = ours(air_of(extinction=fog_air(extinction)), *YARD, car=crossing_car())
    assert found.mean() == pytest.approx(expected.mean(), rel=0.05)
    # The beams' edge is finer than so few pixels, where each is seen through its middle alone.
    fine = 4
    rastered = ours(
        air_of(extinction=fog_air(extinction)),
        *YARD,
        car=crossing_car(),
        pack="raster",
        size=(fine * SIZE[0], fine * SIZE[1]),
    )
    # It lacks mutual light of walls, and some of the halo of the lamp beyond the edge.
    assert rastered.mean() == pytest.approx(expected.mean(), rel=0.10)


def _blocks(picture: NDArray[Any]) -> NDArray[Any]:
    """Means of squares of ten pixels."""
    high, wide = picture.shape[0] // 10, picture.shape[1] // 10
    return picture.reshape(high, 10, wide, 10).mean(axis=(1, 3))
