"""Imported OpenDRIVE maps against samples of the standard's formulas.

    python benchmarks/maps.py [--worst 5] FILE_OR_FOLDER ...

Every lane for motor vehicles is sampled each half metre in the file, by `opendrive_samples`, and in
the road that advercity builds of it. Each sample is compared with the nearest of the other side:
from the file to the import, so that missing lanes show, and back, so that invented ones do. Parts
of lanes that are narrower than a metre are not compared.

A row of the table has the numbers of roads and of lanes, a lane counted in each lane section; their
length; the distances of centre lines both ways, p50 / p99 / maximum; of the samples of the file and
their nearest the differences of width, heading and height, p99; the part of their lanes' area that
is more than 0.3 m off all paving; the part of them whose speed limits differ; the transitions from
lane to lane in the file that no car can make; the verdict. `--worst` prints the samples that differ
most.
"""

import argparse
import math
import sys
import traceback
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import shapely
from advercity_dsl import MapFile, MapNetwork, Road
from numpy.typing import NDArray
from opendrive_links import count_links, list_missing_links
from opendrive_samples import Floats, LaneSamples, OpenDriveMap, build_poses
from scipy.spatial import KDTree
from shapely.geometry.base import BaseGeometry

from advercity.errors import InputError
from advercity.foreign.ledger import describe_left_out
from advercity.roads.lane_segments import LaneSegment
from advercity.roads.map_import import import_map
from advercity.roads.network_file import parse_packed_network
from advercity.roads.road_network import RoadNetwork, build_road

STEP_M = 0.5
MIN_WIDTH_M = 1.0
MAX_SPEED_DIFFERENCE_M_S = 0.05
PAVING_TOLERANCE_M = 0.3
GOALS = {
    "missing lanes": 0.3,
    "invented lanes": 0.3,
    "widths": 0.3,
    "headings": 5.0,
    "heights": 0.3,
    "paving": 0.01,
    "speeds": 0.01,
    "links": 0,
}
"""At most, by column, in a map that is as in its file: p99 in m and degrees, parts, a number."""
NO_ROADWAY = ("sidewalk", "crossing", "parking")
"""Kinds of imported lanes that no lane for vehicles is compared with."""
HEADER = (
    "map",
    "roads",
    "lanes",
    "km",
    "file to import, m",
    "import to file, m",
    "width, m",
    "heading, °",
    "height, m",
    "unpaved",
    "other speed",
    "no way",
    "verdict",
)


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of lanes.

    Attributes:
        values: (n, 6) x, y, z, heading, width and speed limit, NaN without one; m, rad, m/s.
        labels: (n,) lane and place of each.
    """

    values: Floats
    labels: NDArray[np.str_]

    def select(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> "Samples":
        """Take some samples."""
        return Samples(self.values[rows], self.labels[rows])

    @property
    def points(self) -> Floats:
        """Points (n, 3) of the centre lines."""
        return self.values[:, :3]

    @property
    def directions(self) -> Floats:
        """Unit vectors (n, 2) of travel."""
        heading = self.values[:, 3]
        return np.column_stack([np.cos(heading), np.sin(heading)])

    @property
    def poses(self) -> Floats:
        """Rows (n, 5) whose distances say how alike samples are."""
        return build_poses(self.points, self.values[:, 3])


@dataclass(frozen=True, eq=False)
class Differences:
    """Samples of one side against the nearest of the other, a value for each."""

    samples: Samples
    nearest: Samples
    distance_m: Floats
    heading_deg: Floats
    height_m: Floats
    width_m: Floats
    has_other_speed: NDArray[np.bool_]


def compare(samples: Samples, others: Samples) -> Differences:
    """Compare samples with the nearest of others."""
    index = np.asarray(KDTree(others.poses).query(samples.poses)[1], dtype=np.intp)
    nearest = others.select(index)
    gap = samples.values - nearest.values
    along, aside = nearest.directions, nearest.directions[:, ::-1] * (-1, 1)
    ahead_m = np.abs((gap[:, :2] * along).sum(axis=1))
    return Differences(
        samples,
        nearest,
        # Lanes go on between two samples, so that only beyond a lane's end something is missing.
        distance_m=np.hypot((gap[:, :2] * aside).sum(axis=1), np.maximum(ahead_m - STEP_M, 0.0)),
        heading_deg=np.abs(np.degrees(np.angle(np.exp(1j * gap[:, 3])))),
        height_m=np.abs(gap[:, 2]),
        width_m=np.abs(gap[:, 4]),
        has_other_speed=np.abs(gap[:, 5]) > MAX_SPEED_DIFFERENCE_M_S,
    )


def sample_file(lanes: Iterable[LaneSamples]) -> Samples:
    """Join the samples of lanes."""
    rows: list[Floats] = []
    labels: list[str] = []
    for lane in lanes:
        columns = lane.centre, lane.heading, lane.width_m, lane.speed_limit_m_s
        rows.append(np.column_stack(columns))
        place = f"road {lane.road} section {lane.section} lane {lane.lane} {lane.type}"
        labels += [f"{place} s={s:.1f}" for s in lane.s]
    return _join(rows, labels)


def sample_import(
    lanes: Iterable[LaneSegment], speeds_m_s: dict[str, float], offset_m: Sequence[float]
) -> Samples:
    """Join the samples of imported lanes, in the coordinates of the map."""
    rows: list[Floats] = []
    labels: list[str] = []
    for lane in lanes:
        at = np.linspace(0.0, lane.length_m, max(2, math.ceil(lane.length_m / STEP_M) + 1))
        left, centre, right = (lane.points_at(at, part) for part in np.linspace(0.0, 1.0, 3))
        heading = np.arctan2(*np.gradient(centre[:, :2], axis=0).T[::-1])
        width_m = np.linalg.norm(left - right, axis=1)
        # Inside junctions, SUMO's limit is how fast the curve can be driven.
        speed_m_s = math.nan if lane.in_junction else speeds_m_s.get(lane.id, math.nan)
        limit = np.full_like(at, speed_m_s)
        points = centre + np.array([*offset_m, 0.0])
        rows.append(np.column_stack([points, heading, width_m, limit]))
        labels += [f"{lane.kind} {lane.id} at {station:.1f}" for station in at]
    return _join(rows, labels)


def _join(rows: Sequence[Floats], labels: Sequence[str]) -> Samples:
    values = np.concatenate(rows) if rows else np.zeros((0, 6))
    return Samples(values, np.array(labels, dtype=np.str_)).select(values[:, 4] >= MIN_WIDTH_M)


@dataclass(frozen=True)
class Comparison:
    """A row of the table, and the samples that differ most."""

    row: tuple[str, ...]
    is_as_wanted: bool
    worst: tuple[str, ...] = ()


def compare_map(path: Path, worst_count: int = 0) -> Comparison:
    """Compare one map with what advercity makes of it."""
    try:
        imported = import_map(MapFile(source="opendrive", file=path.name), ROAD, path.parent)
        road = build_road(ROAD.model_copy(update={"imported": imported}))
    except InputError as error:
        return _build_verdict(path, f"refused: {error}", is_as_wanted=True)
    except Exception as error:
        remark = f"TRACEBACK: {type(error).__name__}: {error}"
        worst = traceback.format_exc().splitlines()[-worst_count:] if worst_count else []
        return _build_verdict(path, remark, is_as_wanted=False, worst=worst)
    try:
        opendrive = OpenDriveMap(_read_root(path))
        return _compare_road(path, opendrive, imported, road, worst_count)
    except ValueError as error:
        return _build_verdict(path, f"imported, not compared: {error}", is_as_wanted=False)


def _compare_road(
    path: Path, opendrive: OpenDriveMap, imported: MapNetwork, road: RoadNetwork, worst_count: int
) -> Comparison:
    network = parse_packed_network(imported.network)
    speeds_m_s = {lane.id: lane.speed_limit_m_s for lane in network.lanes}
    file_lanes = list(opendrive.sample_vehicle_lanes(STEP_M))
    of_file = sample_file(file_lanes)
    roadway = [lane for lane in road.lanes if lane.kind not in NO_ROADWAY]
    driving = [lane for lane in roadway if lane.kind == "driving"]
    of_import, of_driving = (
        sample_import(lanes, speeds_m_s, imported.offset_m) for lanes in (roadway, driving)
    )
    there, back = compare(of_file, of_import), compare(of_driving, of_file)
    missing_links = list_missing_links(
        opendrive, road.lanes, network.connections, imported.offset_m
    )
    unpaved = measure_unpaved_part(file_lanes, road.paved_area, imported.offset_m)
    other_speed = float(there.has_other_speed.mean())
    found = [
        (_p99(there.distance_m), _describe_spread(there.distance_m)),
        (_p99(back.distance_m), _describe_spread(back.distance_m)),
        (_p99(there.width_m), f"{_p99(there.width_m):.2f}"),
        (_p99(there.heading_deg), f"{_p99(there.heading_deg):.1f}"),
        (_p99(there.height_m), f"{_p99(there.height_m):.2f}"),
        (unpaved, f"{unpaved:.1%}"),
        (other_speed, f"{other_speed:.0%}"),
        (len(missing_links), f"{len(missing_links)} of {count_links(opendrive)}"),
    ]
    faults = [
        name
        for (name, goal), (value, _) in zip(GOALS.items(), found, strict=True)
        if not value <= goal
    ]
    verdict = f"OFF: {', '.join(faults)}" if faults else "as in the file"
    if imported.left_out:
        verdict += f"; left out: {describe_left_out(imported.left_out)}"
    size = len(opendrive.roads), len(file_lanes), f"{len(of_file.values) * STEP_M / 1000:.2f}"
    row = (_name(path), *map(str, size), *(text for _, text in found), verdict)
    worst = [*_describe_worst(there, back, worst_count), *missing_links[:worst_count]]
    return Comparison(row, not faults, tuple(worst))


def _p99(values: Floats) -> float:
    return float(np.percentile(values, 99))


def _describe_spread(values: Floats) -> str:
    return " / ".join(f"{np.percentile(values, part):.2f}" for part in (50, 99, 100))


def measure_unpaved_part(
    lanes: Iterable[LaneSamples], paved_area: BaseGeometry, offset_m: Sequence[float]
) -> float:
    """Measure the part of the area of lanes, in map coordinates, that is off all paving."""
    quads: list[Floats] = []
    for lane in lanes:
        sides = lane.borders[..., :2] - offset_m
        quads.append(np.stack([sides[0][:-1], sides[0][1:], sides[1][1:], sides[1][:-1]], axis=1))
    areas = shapely.make_valid(shapely.polygons(np.concatenate(quads)))
    roadway = shapely.union_all(areas, grid_size=0.001)
    unpaved = shapely.difference(roadway, shapely.buffer(paved_area, PAVING_TOLERANCE_M))
    return float(unpaved.area / roadway.area)


def _describe_worst(there: Differences, back: Differences, count: int) -> Iterator[str]:
    """Describe the samples that differ most, one of each lane."""
    kinds = {
        "file to import, m": (there, there.distance_m),
        "import to file, m": (back, back.distance_m),
        "width, m": (there, there.width_m),
        "heading, °": (there, there.heading_deg),
        "height, m": (there, there.height_m),
        "speed": (there, there.has_other_speed.astype(float)),
    }
    for kind, (differences, values) in kinds.items():
        seen: set[str] = set()
        for index in np.argsort(-values, kind="stable"):
            label = str(differences.samples.labels[index])
            lane = label.rsplit(" ", 1)[0]
            if len(seen) == count or values[index] < 0.05:
                break
            if lane not in seen:
                seen.add(lane)
                this, other = (s.values[index] for s in (differences.samples, differences.nearest))
                yield (
                    f"{kind} {values[index]:.2f}: {label} {_format(this)};"
                    f" nearest {differences.nearest.labels[index]} {_format(other)}"
                )


def _format(values: Floats) -> str:
    x, y, z, heading, width, speed = values
    return (
        f"({x:.2f} {y:.2f} {z:.2f}, {math.degrees(heading):.0f}°, {width:.2f} m wide,"
        f" {speed:.2f} m/s)"
    )


def _build_verdict(
    path: Path, remark: str, *, is_as_wanted: bool, worst: Sequence[str] = ()
) -> Comparison:
    try:
        roads = str(sum(1 for _ in _read_root(path).iterfind("road")))
    except ElementTree.ParseError:
        roads = ""
    row = (_name(path), roads, *[""] * (len(HEADER) - 3), remark.replace("|", "/"))
    return Comparison(row, is_as_wanted, tuple(worst))


def _name(path: Path) -> str:
    return f"{path.parent.name}/{path.stem}"


def _read_root(path: Path) -> ElementTree.Element:
    """Read a map that the importer has found safe, without a default namespace."""
    root = ElementTree.parse(path).getroot()
    for item in root.iter():
        item.tag = item.tag.rpartition("}")[2]
    return root


ROAD = Road.model_validate(
    {
        "kind": "road",
        "id": "map",
        "land_use": "rural",
        "junction": "intersection",
        "alignment": "straight",
        "profile": "level",
        "imported": {"source": "opendrive", "file": "map.xodr"},
        "agents": {},
        "traffic": {
            "vehicles_per_area": 1,
            "walkers": 0,
            "crossing_share": 0,
            "around_agent_m": 50,
            "around_path_m": 15,
            "classes": {"car": 1, "van": 0, "truck": 0, "bicycle": 0, "motorcycle": 0},
        },
    }
)
"""A road in the country, which the importer needs to know of; maps of towns get more crossings."""


def _list_files(places: Iterable[Path]) -> Iterator[Path]:
    for place in places:
        yield from sorted(place.rglob("*.xodr")) if place.is_dir() else [place]


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; the exit code is 1 if some map is neither as in its file nor refused."""
    parser = argparse.ArgumentParser(description="Compare imported OpenDRIVE maps.")
    parser.add_argument("--worst", type=int, default=0, metavar="N")
    parser.add_argument("places", nargs="+", type=Path, metavar="FILE_OR_FOLDER")
    options = parser.parse_args(arguments)
    print(f"| {' | '.join(HEADER)} |\n|{'---|' * len(HEADER)}")
    all_as_wanted = True
    for path in _list_files(options.places):
        found = compare_map(path, options.worst)
        print(f"| {' | '.join(found.row)} |", flush=True)
        for line in found.worst:
            print(f"    {line}", file=sys.stderr, flush=True)
        all_as_wanted &= found.is_as_wanted
    return 0 if all_as_wanted else 1


if __name__ == "__main__":
    sys.exit(main())
