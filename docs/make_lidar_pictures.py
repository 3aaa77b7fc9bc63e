"""Count the points that LiDARs report in every weather, and plot them.

    python docs/make_lidar_pictures.py [FOLDER]

Writes `lidar_by_weather.md` to the parent of FOLDER (by default `docs/images`), and to FOLDER a
plot of that table and, for some weathers, the cloud of a vehicle from above, coloured by the kind
of each point. The three vehicles of a busy urban intersection have the same poses in all weathers.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from advercity_dsl import Agent, Spec, Weather
from matplotlib.figure import Figure
from numpy.typing import NDArray

from advercity.compiler import find_weather
from advercity.compiler.crossing import compile_library
from advercity.physics.atmosphere import compute_atmosphere
from advercity.pipeline.preparation import load_or_build_world, load_or_simulate_traffic
from advercity.randomness import create_generator
from advercity.rendering.raycaster import Raycaster
from advercity.semantics import Semantic
from advercity.sensors.agent_poses import AgentPoses
from advercity.sensors.lidar import cast_scan, derive_lidar_conditions, measure_point_cloud
from advercity.sensors.measurements import PointCloud, PointKind
from advercity.viewer.cloud_colours import KIND_COLOURS

ROOT = Path(__file__).parents[1]
SPEC = "ui_clear_day_dense"
FRAME = 50
PRESETS = ("clear", "soft_rain", "heavy_rain", "fog", "foggy_heavy_rain")
NEAR_M, SIZE_PX = 50.0, 640
"""Half of what a picture shows, and its size."""
MIN_RING_FRACTION = 0.02
"""Fraction of a ring's beams that must hit the road for the ring to count."""
EXAMPLES = ("snow_day", "snow_night", "dust_day")
"""Weathers of the examples, in addition to the presets."""
PICTURED = ("fog_day", "heavy_rain_day", "snow_day")


@dataclass(frozen=True)
class Row:
    """Mean numbers of points of the vehicles' LiDARs in a weather."""

    weather: str
    surface: float
    airborne: float
    ghosts: float
    range_m: float
    """95 % quantile of the ranges of surfaces."""
    rings: float
    """Number of rings on the road."""

    @property
    def air_fraction(self) -> float:
        """Fraction of all points that come from the air."""
        return self.airborne / (self.surface + self.airborne + self.ghosts)


class Scene:
    """Three vehicles in a frame, and the world around them."""

    def __init__(self, spec: Spec) -> None:
        stage = load_or_simulate_traffic(spec)
        self._viewpoints = AgentPoses(spec, stage.trace)
        self._caster = Raycaster(load_or_build_world(spec, stage.network_path))
        self._frame = self._viewpoints.load_frame(FRAME)
        self._spec = spec

    def measure_clouds(self, weather: Weather) -> list[PointCloud]:
        """Measure the point clouds of all vehicles."""
        agents = [agent for agent in self._spec.agents if agent.place.kind == "vehicle"]
        return [self._measure_cloud(agent, weather) for agent in agents]

    def _measure_cloud(self, agent: Agent, weather: Weather) -> PointCloud:
        air = derive_lidar_conditions(
            compute_atmosphere(weather, self._spec.road.land_use), weather.lens
        )
        self._caster.place(self._frame, frozenset({agent.number}))
        pose = self._viewpoints.world_from_sensors("lidar", agent, self._frame)[0]
        lidar = agent.sensors.lidars[0]
        scan = cast_scan(lidar, pose, self._caster, puddle_coverage=air.puddle_coverage)
        key = "pictures", agent.id
        return measure_point_cloud(
            lidar, scan, air, create_generator(*key), states=self._frame.states, window_key=key
        )


def main() -> None:
    """Measure all weathers and write table and pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", default=ROOT / "docs" / "images", type=Path)
    folder: Path = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    spec = next(spec for spec in compile_library(ROOT / "library") if spec.id == SPEC)
    scene = Scene(spec)
    names = [*(f"{name}_{time}" for name in PRESETS for time in ("day", "night")), "glare_day"]
    files = [str(ROOT / "library" / "examples" / f"{name}.yaml") for name in EXAMPLES]
    rows: list[Row] = []
    for weather in (find_weather(name).declaration for name in (*names, *files)):
        clouds = scene.measure_clouds(weather)
        rows.append(build_row(weather.id, clouds))
        if weather.id in PICTURED:
            path = folder / f"lidar_{weather.id}.png"
            cv2.imwrite(str(path), draw_from_above(clouds[0])[..., ::-1])
    page = f"# LiDAR points by weather\n\n{format_table(rows)}"
    (folder.parent / "lidar_by_weather.md").write_text(page)
    plot(rows).savefig(folder / "lidar_by_weather.png", dpi=90, metadata={"Software": None})


def build_row(weather: str, clouds: Sequence[PointCloud]) -> Row:
    """Compute the figures of a weather."""
    surface = [cloud.kind == PointKind.SURFACE for cloud in clouds]
    ghosts = [cloud.kind == PointKind.GHOST for cloud in clouds]
    ranges = [cloud.range_m[on] for cloud, on in zip(clouds, surface, strict=True)]
    count, of_ghosts = (float(np.mean([one.sum() for one in parts])) for parts in (surface, ghosts))
    return Row(
        weather=weather,
        surface=count,
        airborne=float(np.mean([len(cloud.kind) for cloud in clouds])) - count - of_ghosts,
        ghosts=of_ghosts,
        range_m=float(np.quantile(np.concatenate(ranges), 0.95)),
        rings=float(np.mean([count_road_rings(cloud) for cloud in clouds])),
    )


def count_road_rings(cloud: PointCloud) -> int:
    """Count the channels with points on the road."""
    on_road = (cloud.semantic == Semantic.ROAD) & (cloud.kind == PointKind.SURFACE)
    return int((np.bincount(cloud.ring[on_road], minlength=32) > MIN_RING_FRACTION * 3750).sum())


def format_table(rows: Sequence[Row]) -> str:
    """Format the rows in Markdown."""
    lines = [
        "| weather | from surfaces | from the air | of all points | ghosts | 95 % range, m"
        " | road rings |",
        "|---|---|---|---|---|---|---|",
        *(
            f"| {row.weather} | {row.surface:.0f} | {row.airborne:.0f} | {row.air_fraction:.1%}"
            f" | {row.ghosts:.0f} | {row.range_m:.1f} | {row.rings:.1f} |"
            for row in rows
        ),
    ]
    return "\n".join(lines) + "\n"


def plot(rows: Sequence[Row]) -> Figure:
    """Plot points and range by weather."""
    figure = Figure(figsize=(8.0, 4.6), layout="constrained")
    points, ranges = figure.subplots(1, 2, sharey=True, width_ratios=[2, 1])
    names = [row.weather.replace("_", " ") for row in rows]
    surface = np.array([row.surface for row in rows]) / 1e3
    airborne = np.array([row.airborne for row in rows]) / 1e3
    points.barh(names, surface, color="steelblue", label="surfaces")
    points.barh(names, airborne, left=surface, color="lightsteelblue", label="from the air")
    points.set_xlabel("thousand points per scan")
    points.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    points.invert_yaxis()
    ranges.barh(names, [row.range_m for row in rows], color="darkseagreen")
    ranges.set_xlabel("95 % range of surfaces, m")
    return figure


def draw_from_above(cloud: PointCloud) -> NDArray[np.uint8]:
    """Draw a cloud from above (n, n, 3) RGB, x up, coloured by kind; airborne points on top."""
    picture = np.full((SIZE_PX, SIZE_PX, 3), 16, np.uint8)
    scale = SIZE_PX / (2.0 * NEAR_M)
    for kind in sorted(KIND_COLOURS):
        places = cloud.points[cloud.kind == kind, :2]
        row, column = (((NEAR_M - places) * scale).astype(int)).T
        inside = (row >= 0) & (row < SIZE_PX) & (column >= 0) & (column < SIZE_PX)
        picture[row[inside], column[inside]] = KIND_COLOURS[kind]
    return picture


if __name__ == "__main__":
    main()
