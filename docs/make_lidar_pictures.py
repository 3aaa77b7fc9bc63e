"""Counts what LiDARs report in every weather, and draws it.

    python docs/make_lidar_pictures.py [FOLDER]

Writes `lidar_by_weather.md` beside FOLDER (by default `docs/images`), and into FOLDER a plot of
that table and, for some weathers, the cloud of a vehicle from above, coloured by what sent each
echo. The three vehicles of a busy urban intersection look from the same places in all of them.
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
from advercity.pipeline.agent_poses import AgentPoses
from advercity.pipeline.preparation import load_or_build_world, load_or_simulate_traffic
from advercity.randomness import create_generator
from advercity.rendering.raycaster import Raycaster
from advercity.semantics import Semantic
from advercity.sensors.lidar import cast_scan, derive_lidar_conditions, measure_point_cloud
from advercity.sensors.measurements import PointCloud, PointKind
from advercity.viewer.cloud_colours import KIND_COLOURS

ROOT = Path(__file__).parents[1]
SPEC = "ui_clear_day_dense"
FRAME = 50
PRESETS = ("clear", "soft_rain", "heavy_rain", "fog", "foggy_heavy_rain")
NEAR_M, SIZE_PX = 50.0, 640
"""How far a picture reaches from its middle, and how large it is."""
LEAST_SHARE = 0.02
"""Of a ring's beams that must find the road for the ring to be there."""
EXAMPLES = ("snow_day", "snow_night", "dust_day")
"""Weathers declared to copy from, beside the presets."""
PICTURED = ("fog_day", "heavy_rain_day", "snow_day")


@dataclass(frozen=True)
class Row:
    """What the vehicles' LiDARs report in a weather, in the mean of them."""

    weather: str
    surface: float
    airborne: float
    ghosts: float
    range_m: float
    """Where 95 % of what comes from surfaces is nearer."""
    rings: float
    """Rings that find the road."""

    @property
    def airborne_share(self) -> float:
        """Of all points."""
        return self.airborne / (self.surface + self.airborne + self.ghosts)


class Place:
    """Three vehicles at a moment, and the world around them."""

    def __init__(self, spec: Spec) -> None:
        stage = load_or_simulate_traffic(spec)
        self._viewpoints = AgentPoses(spec, stage.trace)
        self._caster = Raycaster(load_or_build_world(spec, stage.network_path))
        self._frame = self._viewpoints.load_frame(FRAME)
        self._spec = spec

    def clouds(self, weather: Weather) -> list[PointCloud]:
        """What the vehicles report."""
        agents = [agent for agent in self._spec.agents if agent.place.kind == "vehicle"]
        return [self._cloud(agent, weather) for agent in agents]

    def _cloud(self, agent: Agent, weather: Weather) -> PointCloud:
        air = derive_lidar_conditions(
            compute_atmosphere(weather, self._spec.road.land_use), weather.lens
        )
        self._caster.place(self._frame, frozenset({agent.number}))
        pose = self._viewpoints.world_from_lidar(agent, self._frame)
        lidar = agent.sensors.lidar
        scan = cast_scan(lidar, pose, self._caster, puddle_coverage=air.puddle_coverage)
        return measure_point_cloud(
            lidar, scan, air, create_generator("pictures", agent.id), states=self._frame.states
        )


def main() -> None:
    """Count and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", default=ROOT / "docs" / "images", type=Path)
    folder: Path = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    spec = next(spec for spec in compile_library(ROOT / "library") if spec.id == SPEC)
    place = Place(spec)
    names = [*(f"{name}_{time}" for name in PRESETS for time in ("day", "night")), "glare_day"]
    files = [str(ROOT / "library" / "examples" / f"{name}.yaml") for name in EXAMPLES]
    rows: list[Row] = []
    for weather in (find_weather(name).declaration for name in (*names, *files)):
        clouds = place.clouds(weather)
        rows.append(row_of(weather.id, clouds))
        if weather.id in PICTURED:
            path = folder / f"lidar_{weather.id}.png"
            cv2.imwrite(str(path), from_above(clouds[0])[..., ::-1])
    page = f"# The LiDAR by weather\n\n{as_table(rows)}"
    (folder.parent / "lidar_by_weather.md").write_text(page)
    plot(rows).savefig(folder / "lidar_by_weather.png", dpi=90, metadata={"Software": None})


def row_of(weather: str, clouds: Sequence[PointCloud]) -> Row:
    """The figures of a weather."""
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
        rings=float(np.mean([road_rings(cloud) for cloud in clouds])),
    )


def road_rings(cloud: PointCloud) -> int:
    """Channels that see the road around them."""
    on_road = (cloud.semantic == Semantic.ROAD) & (cloud.kind == PointKind.SURFACE)
    return int((np.bincount(cloud.ring[on_road], minlength=32) > LEAST_SHARE * 3750).sum())


def as_table(rows: Sequence[Row]) -> str:
    """The rows in Markdown."""
    lines = [
        "| weather | from surfaces | out of the air | their share | ghosts | 95 % range, m"
        " | road rings |",
        "|---|---|---|---|---|---|---|",
        *(
            f"| {row.weather} | {row.surface:.0f} | {row.airborne:.0f} | {row.airborne_share:.1%}"
            f" | {row.ghosts:.0f} | {row.range_m:.1f} | {row.rings:.1f} |"
            for row in rows
        ),
    ]
    return "\n".join(lines) + "\n"


def plot(rows: Sequence[Row]) -> Figure:
    """Points and range by weather."""
    figure = Figure(figsize=(8.0, 4.6), layout="constrained")
    points, reach = figure.subplots(1, 2, sharey=True, width_ratios=[2, 1])
    names = [row.weather.replace("_", " ") for row in rows]
    surface = np.array([row.surface for row in rows]) / 1e3
    airborne = np.array([row.airborne for row in rows]) / 1e3
    points.barh(names, surface, color="steelblue", label="surfaces")
    points.barh(names, airborne, left=surface, color="lightsteelblue", label="out of the air")
    points.set_xlabel("thousand points a turn")
    points.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    points.invert_yaxis()
    reach.barh(names, [row.range_m for row in rows], color="darkseagreen")
    reach.set_xlabel("95 % range of surfaces, m")
    return figure


def from_above(cloud: PointCloud) -> NDArray[np.uint8]:
    """The cloud (n, n, 3) RGB, x up, coloured by kind; what flies over what lies."""
    picture = np.full((SIZE_PX, SIZE_PX, 3), 16, np.uint8)
    scale = SIZE_PX / (2.0 * NEAR_M)
    for kind in (PointKind.SURFACE, *(other for other in PointKind if other)):
        places = cloud.points[cloud.kind == kind, :2]
        row, column = (((NEAR_M - places) * scale).astype(int)).T
        inside = (row >= 0) & (row < SIZE_PX) & (column >= 0) & (column < SIZE_PX)
        picture[row[inside], column[inside]] = KIND_COLOURS[kind]
    return picture


if __name__ == "__main__":
    main()
