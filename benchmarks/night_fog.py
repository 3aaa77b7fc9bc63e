"""Lamps in fog by night against two path tracers: `python benchmarks/night_fog.py`.

One is Mitsuba's `volpath` with the same phase function and lamps; `--mitsuba 0` leaves it out. It
meets light near a lamp by chance only, so its means rise until it has traced some ten million
paths. The other is the backward Monte Carlo below, which follows light from the eye, draws a part
of all directions towards lamps, and has the same means in seconds: the packs are compared with it.
Both take from the product only the phase function and the patterns of lamps. Luminances are means
over a card of 0.6 x 1.7 m that reflects 80 %, and over adjacent air, or of air alone.
"""

import argparse
import importlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from unittest.mock import patch

import numpy as np
from advercity_sapien import SapienBackend
from numpy.typing import NDArray

from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.materials import CONCRETE_77GHZ, MATERIALS, Material
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.extinction import AirExtinction, extinction_from_mor
from advercity.physics.lamp_beams import LOW_BEAM
from advercity.physics.photometry import LUMINANCE_WEIGHTS
from advercity.physics.scattering import PhaseLobes, henyey_greenstein
from advercity.physics.sky import build_airlight_cubemap
from advercity.physics.weather_parts.part import Extinction, Suspension
from advercity.rendering.backend import CameraView, RenderProfile
from advercity.rendering.light_sources import LAMP_BODY_CLEARANCE_M
from advercity.rendering.raycaster import MATERIAL_INDEX
from advercity.semantics import Semantic
from advercity.world import Body, StreetLamp, World

EYE = np.array([-2.0, 0.0, 1.4])
ROAD_ALBEDO, CARD_ALBEDO = 0.1, 0.8
LAMP_CD, LAMP_HEIGHT_M, HALF_TRACK_M, LAMP_SIZE2_M2 = 20e3, 0.65, 0.63, 0.01
STREET_LAMP = StreetLamp((22.0, 3.0, 7.0), 8000.0)
STREET_LAMP_CD = STREET_LAMP.flux_lm / math.pi
VISIBILITIES_M = 50.0, 75.0, 90.0
LOBES = PhaseLobes.from_diameter_um(12.0)
MAX_SCATTERINGS, MAX_STEP_M, ROULETTE_AFTER = 30, 400.0, 8
LAMP_SAMPLING, LAMP_SAMPLING_G = 0.35, 0.97
"""Fraction of directions that are drawn towards lamps, and how narrowly."""
Pack = Literal["raster", "ray_traced"]
VIEW_PX, BATCHES = 320, 20
"""Edge of Mitsuba's view, of which it renders the patch; and of what errors are estimated."""
FOG_FREE_M = 0.05
"""Around lamps of Mitsuba's: a point without size would outshine everything."""
BEAM_OPENING_RAD, STREET_OPENING_RAD, PATTERN_TEXELS = math.radians(60.0), math.radians(88.0), 2048


@dataclass(frozen=True)
class Patch:
    """A rectangle across the view: its distance ahead, its left and right end, and its heights."""

    x: float
    y: tuple[float, float]
    z: tuple[float, float]


@dataclass(frozen=True)
class Scene:
    """A car's low beams or a street lamp, perhaps a card ahead, and the patch that is measured.

    Attributes:
        lamps_at: Middle between the beams' lamps, on the road.
        yaw: Heading of the beams.
        card_m: Distance of a card straight ahead.
        street: Whether the street lamp is lit, and no beams.
    """

    name: str
    patch: Patch
    lamps_at: tuple[float, float] = (0.0, 0.0)
    yaw: float = 0.0
    card_m: float | None = None
    street: bool = False

    @property
    def facing(self) -> Float64Array:
        """Unit vector (3,) along the axis of the lamps."""
        if self.street:
            return np.array([0.0, 0.0, -1.0])
        return np.array([math.cos(self.yaw), math.sin(self.yaw), 0.0])

    def list_lamps(self) -> list[Float64Array]:
        """Positions (3,) of all lamps."""
        if self.street:
            return [np.array(STREET_LAMP.position)]
        left = np.array([-math.sin(self.yaw), math.cos(self.yaw), 0.0])
        middle = np.array([*self.lamps_at, LAMP_HEIGHT_M])
        return [middle + side * HALF_TRACK_M * left for side in (1.0, -1.0)]

    def lamp_intensity_cd(self, rays: Float64Array) -> Float64Array:
        """Intensity (n,) of each lamp along rays (n, 3)."""
        if self.street:
            return STREET_LAMP_CD * np.maximum(-rays[:, 2], 0.0)
        return LAMP_CD * LOW_BEAM.relative_intensity(self.facing[None], rays[None])[0]


def list_scenes() -> list[Scene]:
    """Cards in the own beams with the air beside them, beams seen otherwise, and a street lamp."""
    scenes: list[Scene] = []
    for card_m in (15.0, 20.0, 30.0, 40.0, 50.0):
        on_card, beside = ((-0.3, 0.3), (1.0, 2.0))
        for what, y in (("card", on_card), ("adjacent air", beside)):
            patch_ = Patch(card_m, y, (0.05, 1.65))
            scenes.append(Scene(f"{what}, {card_m:g} m", patch_, card_m=card_m))
    return [
        *scenes,
        Scene("own beams, 4 to 6 degrees up", Patch(40.0, (-2.0, 2.0), (4.3, 5.8))),
        Scene("own beams, 13 to 16 degrees up", Patch(40.0, (-2.0, 2.0), (11.1, 13.4))),
        Scene("own beams, 25 degrees aside", Patch(40.0, (18.0, 22.0), (2.0, 4.0))),
        Scene("own beams, 4 degrees down", Patch(18.0, (1.0, 3.0), (0.1, 0.4))),
        Scene(
            "oncoming, 5 degrees off", Patch(40.0, (-1.5, 0.5), (1.0, 2.0)), (38.0, 3.2), math.pi
        ),
        Scene(
            "crossing, in front", Patch(40.0, (-2.0, 2.0), (0.2, 1.0)), (15.0, 14.0), -math.pi / 2
        ),
        Scene("street lamp, 5 degrees off", Patch(40.0, (0.8, 2.4), (10.4, 12.0)), street=True),
        Scene("road before a street lamp", Patch(18.0, (1.5, 3.5), (0.1, 0.4)), street=True),
        Scene(
            "card under a street lamp",
            Patch(25.0, (-0.3, 0.3), (0.05, 1.65)),
            card_m=25.0,
            street=True,
        ),
    ]


class Reference:
    """Traces one scene backwards."""

    def __init__(self, scene: Scene, extinction_per_m: float, seed: int) -> None:
        self.scene, self.extinction = scene, extinction_per_m
        self.random = np.random.default_rng(seed)
        self.lamps = scene.list_lamps()
        cosine = np.linspace(-1.0, 1.0, 20_001)
        self._wide = np.cumsum(LOBES.wide_phase(cosine)), cosine

    def trace(self, rays: Float64Array) -> Float64Array:
        """Trace luminances (n,) in cd/m² that come along rays (n, 3) from the eye."""
        found = np.zeros(len(rays))
        at, ray = np.tile(EYE, (len(rays), 1)), rays
        weight, number = np.ones(len(rays)), np.arange(len(rays))
        for step in range(MAX_SCATTERINGS):
            surface, kind = self._find_surface(at, ray)
            free = self.random.exponential(1.0 / self.extinction, len(at))
            kind = np.where(free < surface, 0, kind)
            length = np.minimum(free, surface)
            kept = length < MAX_STEP_M
            at, ray, weight, number = at[kept], ray[kept], weight[kept], number[kept]
            kind, length = kind[kept], length[kept]
            at = at + length[:, None] * ray
            np.add.at(found, number, weight * self._light_of_lamps(at, ray, kind))
            ray, factor = self._turn(at, ray, kind)
            at = at + np.where(kind > 0, 1e-4, 0.0)[:, None] * ray
            weight = weight * factor
            if step >= ROULETTE_AFTER:
                chance = np.clip(weight, 0.02, 0.7)
                kept = self.random.random(len(weight)) < chance
                weight = weight / chance
                at, ray, weight, number = at[kept], ray[kept], weight[kept], number[kept]
        return found

    def _find_surface(
        self, at: Float64Array, ray: Float64Array
    ) -> tuple[Float64Array, NDArray[np.int_]]:
        """Distances (n,) to the next surface, and 1 for the road, 2 for the card."""
        down = np.minimum(ray[:, 2], -1e-9)
        road = np.where(ray[:, 2] < -1e-9, -at[:, 2] / down, np.inf)
        kind = np.where(road > 1e-6, 1, 0)
        distance = np.where(road > 1e-6, road, np.inf)
        if self.scene.card_m is not None:
            forward = np.where(np.abs(ray[:, 0]) > 1e-9, ray[:, 0], 1e-9)
            card = (self.scene.card_m - at[:, 0]) / forward
            y, z = (at[:, axis] + card * ray[:, axis] for axis in (1, 2))
            meets = (card > 1e-6) & (card < distance) & (np.abs(y) < 0.3) & (z > 0.0) & (z < 1.7)
            distance, kind = np.where(meets, card, distance), np.where(meets, 2, kind)
        return distance, kind

    def _normals(self, ray: Float64Array, kind: NDArray[np.int_]) -> Float64Array:
        towards = np.where(ray[:, :1] > 0.0, [[-1.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]])
        return np.where((kind == 1)[:, None], [[0.0, 0.0, 1.0]], towards)

    def _light_of_lamps(
        self, at: Float64Array, ray: Float64Array, kind: NDArray[np.int_]
    ) -> Float64Array:
        """Luminance (n,) that lamps give points without any other scattering."""
        albedo = np.where(kind == 1, ROAD_ALBEDO, CARD_ALBEDO)
        normal = self._normals(ray, kind)
        total = np.zeros(len(at))
        for lamp in self.lamps:
            away = at - lamp
            distance = np.linalg.norm(away, axis=1)
            light = away / distance[:, None]
            candela = self.scene.lamp_intensity_cd(light)
            lux = candela / (distance**2 + LAMP_SIZE2_M2) * np.exp(-self.extinction * distance)
            blocked, what = self._find_surface(np.tile(lamp, (len(at), 1)), light)
            lux[(what == 2) & (blocked < distance - 1e-3)] = 0.0
            cosine = np.maximum(-(light * normal).sum(axis=1), 0.0)
            scattered = _phase(-(light * ray).sum(axis=1))
            total += lux * np.where(kind == 0, scattered, albedo / math.pi * cosine)
        return total

    def _turn(
        self, at: Float64Array, ray: Float64Array, kind: NDArray[np.int_]
    ) -> tuple[Float64Array, Float64Array]:
        """Draw the next directions (n, 3), a part of them towards lamps, and their weights (n,)."""
        count = len(at)
        normal, is_surface = self._normals(ray, kind), kind > 0
        scattered = self._deflect(ray, self._draw_cosine(count))
        lambertian = self.random.normal(size=(count, 3))
        lambertian = _unit(_unit(lambertian) + normal)
        turned = np.where(is_surface[:, None], lambertian, scattered)
        to_lamps = [_unit(lamp - at) for lamp in self.lamps]
        chosen = np.where(self.random.random((count, 1)) < 0.5, to_lamps[0], to_lamps[-1])
        g = LAMP_SAMPLING_G
        near = self._deflect(chosen, _draw_henyey_greenstein(g, self.random.random(count)))
        turned = np.where(self.random.random((count, 1)) < LAMP_SAMPLING, near, turned)
        density = np.where(
            is_surface,
            np.maximum((turned * normal).sum(axis=1), 0.0) / math.pi,
            _phase((turned * ray).sum(axis=1)),
        )
        drawn = sum(henyey_greenstein((turned * to).sum(axis=1), g) for to in to_lamps) / len(
            to_lamps
        )
        drawn = LAMP_SAMPLING * drawn + (1.0 - LAMP_SAMPLING) * density
        albedo = np.array([1.0, ROAD_ALBEDO, CARD_ALBEDO])[kind]
        return turned, albedo * density / np.maximum(drawn, 1e-12)

    def _draw_cosine(self, count: int) -> Float64Array:
        number = self.random.random(count)
        cumulative, cosine = self._wide
        wide = np.interp(number * cumulative[-1], cumulative, cosine)
        narrow = _draw_henyey_greenstein(LOBES.narrow_g, number)
        return np.where(self.random.random(count) < LOBES.wide_fraction, wide, narrow)

    def _deflect(self, ray: Float64Array, cosine: Float64Array) -> Float64Array:
        helper = np.where(np.abs(ray[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
        across = _unit(np.cross(helper, ray))
        turn = self.random.random((len(ray), 1)) * 2.0 * math.pi
        sideways = np.cos(turn) * across + np.sin(turn) * np.cross(ray, across)
        return cosine[:, None] * ray + np.sqrt(1.0 - cosine**2)[:, None] * sideways


def _phase(cosine: Float64Array) -> Float64Array:
    cosine = np.clip(cosine, -1.0, 1.0)
    narrow = LOBES.narrow_fraction * henyey_greenstein(cosine, LOBES.narrow_g)
    return narrow + LOBES.wide_fraction * LOBES.wide_phase(cosine)


def _draw_henyey_greenstein(g: float, number: Float64Array) -> Float64Array:
    cosine = (1.0 + g * g - ((1.0 - g * g) / (1.0 - g + 2.0 * g * number)) ** 2) / (2.0 * g)
    return np.clip(cosine, -1.0, 1.0)


def _unit(vectors: Float64Array) -> Float64Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def trace_reference(scene: Scene, mor_m: float, paths: int) -> tuple[float, float]:
    """Compute the mean luminance of a scene's patch in cd/m², and its standard error."""
    patch_ = scene.patch
    means: list[float] = []
    for seed in range(BATCHES):
        reference = Reference(scene, extinction_from_mor(mor_m), seed)
        y, z = (
            low + (high - low) * reference.random.random(paths // BATCHES)
            for low, high in (patch_.y, patch_.z)
        )
        rays = _unit(np.stack([np.full_like(y, patch_.x), y, z], axis=-1) - EYE)
        means.append(float(reference.trace(rays).mean()))
    return _mean_and_error(means)


def _mean_and_error(means: Sequence[float]) -> tuple[float, float]:
    return float(np.mean(means)), float(np.std(means) / math.sqrt(len(means) - 1))


def trace_with_mitsuba(
    scene: Scene, mor_m: float, paths: int, *, max_depth: int = 64, variant: str = "scalar_rgb"
) -> tuple[float, float]:
    """Compute the mean luminance of a scene's patch in cd/m² by Mitsuba, and its standard error."""
    mitsuba: Any = importlib.import_module("mitsuba")
    mitsuba.set_variant(variant)
    described = _describe_for_mitsuba(mitsuba, scene, mor_m)
    described["integrator"] = {"type": "volpath", "max_depth": max_depth, "rr_depth": 24}
    pixels = described["sensor"]["film"]["crop_width"] * described["sensor"]["film"]["crop_height"]
    loaded, samples = mitsuba.load_dict(described), max(1, paths // BATCHES // pixels)
    means = [
        float(np.asarray(mitsuba.render(loaded, seed=seed, spp=samples)).mean())
        for seed in range(BATCHES)
    ]
    return _mean_and_error(means)


def _describe_for_mitsuba(mitsuba: Any, scene: Scene, mor_m: float) -> dict[str, Any]:
    place, fog = mitsuba.ScalarTransform4f, {"type": "ref", "id": "fog"}
    view, rows, columns = _frame_patch(scene.patch, VIEW_PX)
    wide = LOBES.wide_phase(np.linspace(-1.0, 1.0, 2001))
    found: dict[str, Any] = {
        "type": "scene",
        "fog": {
            "type": "homogeneous",
            "albedo": 1.0,
            "sigma_t": extinction_from_mor(mor_m),
            "phase": {
                "type": "blendphase",
                "weight": LOBES.wide_fraction,
                "narrow": {"type": "hg", "g": LOBES.narrow_g},
                "wide": {"type": "tabphase", "values": ",".join(f"{item:.6g}" for item in wide)},
            },
        },
        "sensor": {
            "type": "perspective",
            "fov": math.degrees(view.horizontal_fov_rad),
            "medium": fog,
            "to_world": place().look_at(
                origin=EYE.tolist(), target=np.add(EYE, (10.0, 0.0, 0.0)).tolist(), up=[0, 0, 1]
            ),
            "film": {
                "type": "hdrfilm",
                "width": VIEW_PX,
                "height": VIEW_PX,
                "crop_offset_x": columns.start,
                "crop_offset_y": rows.start,
                "crop_width": columns.stop - columns.start,
                "crop_height": rows.stop - rows.start,
                "pixel_format": "luminance",
                "rfilter": {"type": "box"},
            },
        },
        "road": {
            "type": "rectangle",
            "to_world": place().scale([400.0, 400.0, 1.0]),
            "bsdf": _matt(ROAD_ALBEDO),
            "exterior": fog,
        },
    }
    if scene.card_m is not None:
        found["card"] = {
            "type": "cube",
            "to_world": place()
            .translate([scene.card_m + 0.05, 0.0, 0.85])
            .scale([0.05, 0.3, 0.85]),
            "bsdf": _matt(CARD_ALBEDO),
            "exterior": fog,
        }
    for number, lamp in enumerate(scene.list_lamps()):
        found[f"lamp_{number}"] = _describe_lamp(mitsuba, scene, lamp)
        found[f"bubble_{number}"] = {
            "type": "sphere",
            "center": lamp.tolist(),
            "radius": FOG_FREE_M,
            "bsdf": {"type": "null"},
            "exterior": fog,
        }
    return found


def _describe_lamp(mitsuba: Any, scene: Scene, at: Float64Array) -> dict[str, Any]:
    """Describe a spot lamp whose texture is the pattern of the scene's lamps."""
    opening = STREET_OPENING_RAD if scene.street else BEAM_OPENING_RAD
    along = np.tan(opening) * ((np.arange(PATTERN_TEXELS) + 0.5) / PATTERN_TEXELS * 2.0 - 1.0)
    left, up = np.meshgrid(along, along)
    axis, upward = scene.facing, np.array([1.0, 0.0, 0.0] if scene.street else [0.0, 0.0, 1.0])
    rays = axis + left[..., None] * np.cross(upward, axis) + up[..., None] * upward
    candela = scene.lamp_intensity_cd(_unit(rays.reshape(-1, 3))).reshape(*left.shape, 1)
    return {
        "type": "spot",
        "to_world": mitsuba.ScalarTransform4f().look_at(
            origin=at.tolist(), target=(at + axis).tolist(), up=upward.tolist()
        ),
        "intensity": _grey(float(candela.max())),
        "cutoff_angle": math.degrees(opening),
        "beam_width": math.degrees(opening) - 0.1,
        "texture": {
            "type": "bitmap",
            "data": mitsuba.TensorXf((candela / candela.max()).astype(np.float32)),
            "raw": True,
        },
    }


def _matt(albedo: float) -> dict[str, Any]:
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": _grey(albedo)}}


def _grey(value: float) -> dict[str, Any]:
    return {"type": "rgb", "value": [value] * 3}


def render_patch(scene: Scene, mor_m: float, pack: Pack, *, width_px: int, samples: int) -> float:
    """Render the mean luminance of a scene's patch in cd/m²."""
    corners = np.array(list(np.ndindex(2, 2, 2))) - 0.5
    front, back, top = ([0, 1, 3], [0, 3, 2]), ([4, 6, 7], [4, 7, 5]), ([1, 5, 7], [1, 7, 3])
    triangles = np.array([*front, *back, *top], np.int32)

    def slab(name: str, middle: Sequence[float], size: Sequence[float], semantic: Semantic) -> Mesh:
        vertices = (np.asarray(middle) + corners * np.asarray(size)).astype(np.float32)
        return Mesh(name, vertices, triangles, name, semantic)

    matt = {
        name: Material((albedo, albedo, albedo), 0.5, CONCRETE_77GHZ, roughness=1.0)
        for name, albedo in (("fog_road", ROAD_ALBEDO), ("fog_card", CARD_ALBEDO))
    }
    meshes = [slab("fog_road", (0.0, 0.0, -0.5), (800.0, 400.0, 1.0), Semantic.ROAD)]
    if scene.card_m is not None:
        at = scene.card_m + 0.05, 0.0, 0.85
        meshes.append(slab("fog_card", at, (0.1, 0.6, 1.7), Semantic.BUILDING))
    size = (4.0, 1.8, 1.5)
    hidden = slab("fog_road", (0.0, 0.0, -3.0), (0.1, 0.1, 0.1), Semantic.VEHICLE)
    behind = size[0] / 2.0 + LAMP_BODY_CLEARANCE_M
    ahead = np.array([math.cos(scene.yaw), math.sin(scene.yaw)])
    at = (*(np.array(scene.lamps_at) - behind * ahead), 0.0)
    actor = Actor(1, "car", "car", "fog_road", size)
    lit = Lamp(0) if scene.street else Lamp.LOW_BEAM
    state = ActorState(actor, pose_matrix(at, yaw=scene.yaw), 0.0, 0.0, lit)
    lamps, cars = (STREET_LAMP,) if scene.street else (), {"car": Body((hidden,), size)}
    world = World("fog", tuple(meshes), cars, (), Path("none"), street_lamps=lamps)
    profile = RenderProfile("fog", 1.0, pack, samples=samples, path_depth=2)
    with (
        patch.dict(MATERIALS, matt),
        patch.dict(MATERIAL_INDEX, dict.fromkeys(matt, 0)),
        patch("advercity.rendering.light_sources.TAIL_CD", 0.0),
        SapienBackend().open(world, _dark_air(mor_m), profile) as renderer,
    ):
        renderer.place(Frame(0, 0.0, (state,), {}))
        view, rows, columns = _frame_patch(scene.patch, width_px)
        seen = renderer.render_camera(view).radiance @ LUMINANCE_WEIGHTS
    return float(seen[rows, columns].mean())


def _frame_patch(patch_: Patch, width_px: int) -> tuple[CameraView, slice, slice]:
    """A level view that holds the patch, and the patch's rows and columns."""
    ahead = patch_.x - EYE[0]
    farthest = max(*map(abs, patch_.y), *(abs(z - EYE[2]) for z in patch_.z), 2.0) * 1.3
    focal_px = width_px / 2.0 * ahead / farthest
    view = CameraView(pose_matrix(EYE), width_px, width_px, 2.0 * math.atan(farthest / ahead))
    rows = sorted(width_px / 2.0 - (z - EYE[2]) / ahead * focal_px for z in patch_.z)
    columns = sorted(width_px / 2.0 - y / ahead * focal_px for y in patch_.y)
    inside = [slice(math.ceil(low), math.floor(high)) for low, high in (rows, columns)]
    return view, inside[0], inside[1]


def _dark_air(mor_m: float) -> Atmosphere:
    extinction = extinction_from_mor(mor_m)
    return Atmosphere(
        extinction=AirExtinction((Suspension("fog", Extinction(extinction, extinction)),)),
        sun_direction=np.array([0.0, 0.0, -1.0]),
        sun_lx=0.0,
        sun_colour=(1.0, 1.0, 1.0),
        sky_lx=0.0,
        sky=np.zeros((6, 8, 8, 3), np.float32),
        airlight=build_airlight_cubemap((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        street_lx=0.0,
        wetness=0.0,
        puddle_coverage=0.0,
        night=True,
    )


def main() -> None:
    """Print luminances of the references, and ratios of both packs to the backward Monte Carlo."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paths", type=int, default=400_000)
    parser.add_argument("--mitsuba", type=int, default=2_000_000, help="paths of Mitsuba's")
    parser.add_argument("--variant", default="scalar_rgb", help="of Mitsuba's")
    parser.add_argument("--mor", type=float, nargs="+", default=VISIBILITIES_M)
    arguments = parser.parse_args()
    print("| visibility | scene | Mitsuba, cd/m² | Monte Carlo, cd/m² | raster | traced |")
    print("|---|---|---|---|---|---|")
    for mor_m in arguments.mor:
        for scene in list_scenes():
            theirs = ""
            if arguments.mitsuba:
                mean, error = trace_with_mitsuba(
                    scene, mor_m, arguments.mitsuba, variant=arguments.variant
                )
                theirs = f"{mean:.3g} ± {error:.2g}"
            mean, error = trace_reference(scene, mor_m, arguments.paths)
            raster = render_patch(scene, mor_m, "raster", width_px=320, samples=1)
            traced = render_patch(scene, mor_m, "ray_traced", width_px=160, samples=12)
            print(
                f"| {mor_m:g} m | {scene.name} | {theirs} | {mean:.3g} ± {error:.2g} |"
                f" {raster / mean:.2f} | {traced / mean:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
