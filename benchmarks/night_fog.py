"""Beams in fog by night against a backward Monte Carlo: `python benchmarks/night_fog.py`.

The reference follows light from the eye backwards through fog of the whole phase function, and
counts at every scattering and on every surface what lamps send there. It takes from the product
only the phase function and the pattern of a low beam. Luminances are means over a card of 0.6 x
1.7 m that reflects 80 %, and over adjacent air, or of air alone. Most of the time is the
reference's: some minutes a visibility.
"""

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
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
from advercity.physics.extinction import AirExtinction, Extinction, extinction_from_mor
from advercity.physics.lamp_beams import LOW_BEAM
from advercity.physics.photometry import LUMINANCE_WEIGHTS
from advercity.physics.scattering import DropletPhaseLobes, henyey_greenstein
from advercity.physics.sky import build_airlight_cubemap
from advercity.rendering.backend import CameraView, RenderProfile
from advercity.rendering.light_sources import LAMP_BODY_CLEARANCE_M
from advercity.rendering.raycaster import MATERIAL_INDEX
from advercity.semantics import Semantic
from advercity.world import Body, World

EYE = np.array([-2.0, 0.0, 1.4])
ROAD_ALBEDO, CARD_ALBEDO = 0.1, 0.8
LAMP_CD, LAMP_HEIGHT_M, HALF_TRACK_M, LAMP_SIZE2_M2 = 20e3, 0.65, 0.63, 0.01
VISIBILITIES_M = 50.0, 63.0, 75.0, 90.0
LOBES = DropletPhaseLobes.from_diameter_um(12.0)
MAX_SCATTERINGS, MAX_STEP_M, ROULETTE_AFTER = 30, 400.0, 8
LAMP_SAMPLING, LAMP_SAMPLING_G = 0.35, 0.97
"""Fraction of directions that are drawn towards lamps, and how narrowly."""
Pack = Literal["raster", "ray_traced"]


@dataclass(frozen=True)
class Patch:
    """A rectangle across the view: its distance ahead, its left and right end, and its heights."""

    x: float
    y: tuple[float, float]
    z: tuple[float, float]


@dataclass(frozen=True)
class Scene:
    """A car's lamps, perhaps a card ahead, and the patch that is measured.

    Attributes:
        lamps_at: Middle between the lamps, on the road.
        yaw: Heading of the beams.
        card_m: Distance of a card straight ahead.
    """

    name: str
    patch: Patch
    lamps_at: tuple[float, float] = (0.0, 0.0)
    yaw: float = 0.0
    card_m: float | None = None

    @property
    def facing(self) -> Float64Array:
        """Unit vector (3,) along the beams."""
        return np.array([math.cos(self.yaw), math.sin(self.yaw), 0.0])

    def list_lamps(self) -> list[Float64Array]:
        """Positions (3,) of both lamps."""
        left = np.array([-math.sin(self.yaw), math.cos(self.yaw), 0.0])
        middle = np.array([*self.lamps_at, LAMP_HEIGHT_M])
        return [middle + side * HALF_TRACK_M * left for side in (1.0, -1.0)]


def list_scenes() -> list[Scene]:
    """Cards in the own beams at four distances with the air beside them; beams seen otherwise."""
    scenes: list[Scene] = []
    for card_m in (20.0, 30.0, 40.0, 55.0):
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
            candela = LAMP_CD * LOW_BEAM.relative_intensity(self.scene.facing[None], light[None])[0]
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
        chosen = np.where(self.random.random((count, 1)) < 0.5, *to_lamps)
        g = LAMP_SAMPLING_G
        near = self._deflect(chosen, _draw_henyey_greenstein(g, self.random.random(count)))
        turned = np.where(self.random.random((count, 1)) < LAMP_SAMPLING, near, turned)
        density = np.where(
            is_surface,
            np.maximum((turned * normal).sum(axis=1), 0.0) / math.pi,
            _phase((turned * ray).sum(axis=1)),
        )
        drawn = sum(henyey_greenstein((turned * to).sum(axis=1), g) for to in to_lamps) / 2.0
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
    patch_, batches = scene.patch, 20
    means: list[float] = []
    for seed in range(batches):
        reference = Reference(scene, extinction_from_mor(mor_m), seed)
        y, z = (
            low + (high - low) * reference.random.random(paths // batches)
            for low, high in (patch_.y, patch_.z)
        )
        rays = _unit(np.stack([np.full_like(y, patch_.x), y, z], axis=-1) - EYE)
        means.append(float(reference.trace(rays).mean()))
    return float(np.mean(means)), float(np.std(means) / math.sqrt(batches - 1))


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
    at = (*(np.array(scene.lamps_at) - behind * scene.facing[:2]), 0.0)
    actor = Actor(1, "car", "car", "fog_road", size)
    state = ActorState(actor, pose_matrix(at, yaw=scene.yaw), 0.0, 0.0, Lamp.LOW_BEAM)
    world = World("fog", tuple(meshes), {"car": Body((hidden,), size)}, (), Path("none"))
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
        extinction=AirExtinction(fog=Extinction(extinction, extinction)),
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
    """Print luminances of the reference and of both packs."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--paths", type=int, default=60_000)
    parser.add_argument("--mor", type=float, nargs="+", default=VISIBILITIES_M)
    arguments = parser.parse_args()
    print("| visibility | scene | reference cd/m² | raster | traced |\n|---|---|---|---|---|")
    for mor_m in arguments.mor:
        for scene in list_scenes():
            mean, error = trace_reference(scene, mor_m, arguments.paths)
            raster = render_patch(scene, mor_m, "raster", width_px=320, samples=1)
            traced = render_patch(scene, mor_m, "ray_traced", width_px=64, samples=64)
            print(
                f"| {mor_m:g} m | {scene.name} | {mean:.3g} ± {error:.2g} |"
                f" {raster / mean:.2f} | {traced / mean:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
