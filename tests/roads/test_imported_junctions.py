"""Junctions, kerbs and crossings of imported maps are where the maps have them."""

import math
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import shapely
from advercity_dsl import MapFile, MapNetwork, Road
from advercity_dsl.road import StripKind

from advercity.roads.map_import import import_map
from advercity.roads.road_network import RoadNetwork, build_road
from advercity.semantics import Semantic
from tests.roads.imported_roads import DATA, declaration
from tests.roads.probing import Floats, looking_down

CENTRE = (48.0, 11.0)
M_PER_DEG = (111_200, 74_625)
"""Metres of a degree of latitude and of longitude at 48 degrees north."""


@pytest.fixture(scope="module")
def slope() -> RoadNetwork:
    """The junction of three streets on a slope of 4 % from west to east."""
    return read_road(DATA / "junction.xodr", "urban")


def test_the_sidewalk_of_a_through_road_passes_the_junction(slope: RoadNetwork) -> None:
    below = looking_down(slope.meshes)
    along = np.column_stack([np.linspace(-12, 12, 49), np.full(49, 4.5)])

    z, found = below(along)

    assert (found == Semantic.SIDEWALK.value).all()
    np.testing.assert_allclose(z, 0.04 * along[:, 0] + 0.15, atol=0.03)


def test_kerbs_follow_the_corners_of_the_map(slope: RoadNetwork) -> None:
    """The turn's reference line is an arc of 10 m about (10, -10); its lane is 3.5 m wide."""
    below = looking_down(slope.meshes)
    turn = np.linspace(np.pi / 2, np.pi, 15)[1:-1]
    outward = np.column_stack([np.cos(turn), np.sin(turn)])

    asphalt, kerb, walk = ((10, -10) + radius * outward for radius in (6.7, 6.43, 5.5))

    assert (below(asphalt)[1] != Semantic.SIDEWALK.value).all()
    assert (below(kerb)[1] == Semantic.SIDEWALK.value).all()
    assert (below(walk)[1] == Semantic.SIDEWALK.value).all()


def test_zebras_lie_on_a_road_that_is_not_level(slope: RoadNetwork) -> None:
    below = looking_down(slope.meshes)
    # Across the western arm: bars of 0.5 m, with gaps of 0.5 m, over 7 m between the kerbs.
    across = np.column_stack([np.full(701, -8.0), np.linspace(-3.5, 3.5, 701)])

    _, found = below(across)

    assert (found == Semantic.ROAD_LINE.value).mean() == pytest.approx(0.5, abs=0.06)


def write_osm(folder: Path, nodes: dict[str, tuple[float, float]], rest: str) -> Path:
    """Write a map with nodes at places in metres; `rest` has their ways, and further nodes."""
    placed = "".join(
        f'<node id="{name}" lat="{CENTRE[0] + y / M_PER_DEG[0]:.8f}"'
        f' lon="{CENTRE[1] + x / M_PER_DEG[1]:.8f}"/>'
        for name, (x, y) in nodes.items()
    )
    path = folder / "map.osm"
    path.write_text(f'<osm version="0.6">{placed}{rest}</osm>', encoding="utf-8")
    return path


def way(name: str, nodes: str, *tags: tuple[str, str]) -> str:
    refs = "".join(f'<nd ref="{node}"/>' for node in nodes.split())
    return f'<way id="{name}">{refs}{"".join(tag(*item) for item in tags)}</way>'


def tag(key: str, value: str) -> str:
    return f'<tag k="{key}" v="{value}"/>'


STREET = (("highway", "secondary"), ("lanes", "2"), ("maxspeed", "50"), ("sidewalk", "both"))


def declare(path: Path, land_use: str) -> tuple[MapFile, Road]:
    origin = {"origin_lat_deg": CENTRE[0], "origin_lon_deg": CENTRE[1]}
    source: Literal["osm", "opendrive"] = "osm" if path.suffix == ".osm" else "opendrive"
    road = Road.model_validate(declaration(source, path.name, **origin) | {"land_use": land_use})
    return MapFile(source=source, file=path.name), road


def read_map(path: Path, land_use: str) -> MapNetwork:
    return import_map(*declare(path, land_use), path.parent)


def read_road(path: Path, land_use: str) -> RoadNetwork:
    _, road = declare(path, land_use)
    return build_road(road.model_copy(update={"imported": read_map(path, land_use)}))


def crossing_middles(road: RoadNetwork) -> Floats:
    lanes = [lane for lane in road.lanes if lane.kind == "crossing"]
    return np.array([(lane.left + lane.right)[:, :2].mean(axis=0) / 2 for lane in lanes])


@pytest.mark.parametrize("pieces", [["1 2 3 4 5 6 1"], ["3 4 5", "1 2 3", "5 6 1"]])
def test_a_roundabout_of_six_nodes_is_round(pieces: list[str], tmp_path: Path) -> None:
    ring = {
        str(k + 1): (18 * math.cos(k * math.pi / 3), 18 * math.sin(k * math.pi / 3))
        for k in range(6)
    }
    tags = STREET[0], ("junction", "roundabout"), ("sidewalk", "right")
    ways = "".join(way(f"5{4 + index}", piece, *tags) for index, piece in enumerate(pieces))
    ways += way("51", "7 1", *STREET) + way("52", "8 3", *STREET) + way("53", "9 5", *STREET)
    ends = {"7": (120.0, 0.0), "8": (-60.0, 104.0), "9": (-60.0, -104.0)}
    road = read_road(write_osm(tmp_path, ring | ends, ways), "urban")

    lanes = [lane for lane in road.lanes if lane.kind == "driving" and not lane.in_junction]
    middles = [(lane.left + lane.right)[:, :2] / 2 for lane in lanes]
    on_ring = [line for line in middles if np.linalg.norm(line, axis=1).max() < 25]

    radii = np.concatenate([np.linalg.norm(line, axis=1) for line in on_ring])
    # A hexagon's sides are 2.4 m nearer to its middle than its corners.
    assert len(on_ring) == 3
    assert np.ptp(radii) < 0.4
    assert len(crossing_middles(road)) == 3
    # The ring's outer border is 19.6 m from its middle.
    assert np.linalg.norm(crossing_middles(road), axis=1).min() > 19.6
    assert not road.paved_area.contains(shapely.Point(0, 0))


@pytest.mark.parametrize("land_use", ["urban", "rural"])
def test_a_map_with_crossings_has_no_others(land_use: str, tmp_path: Path) -> None:
    nodes = {"1": (0, 0), "2": (0, 120), "3": (0, -120), "4": (120, 0), "5": (-120, 0)}
    marked = f'<node id="6" lat="{CENTRE[0]}" lon="{CENTRE[1] + 12 / M_PER_DEG[1]:.8f}">'
    rest = marked + tag("highway", "crossing") + "</node>"
    rest += way("51", "2 1 3", *STREET) + way("52", "5 1 6 4", *STREET)
    path = write_osm(tmp_path, {k: (float(x), float(y)) for k, (x, y) in nodes.items()}, rest)

    middles = crossing_middles(read_road(path, land_use))

    assert len(middles) == 1
    assert middles[0] == pytest.approx((8, 0), abs=5)


@pytest.mark.parametrize(("east_m", "unbuilt"), [(12, 0), (60, 1), (180, 0)])
def test_marked_crossings_that_cannot_be_built_are_listed(
    east_m: float, unbuilt: int, tmp_path: Path
) -> None:
    """One is at the junction, one in the middle of a street, one off all streets."""
    nodes = {"1": (0, 0), "2": (0, 120), "3": (0, -120), "4": (120, 0), "5": (-120, 0)}
    longitude = CENTRE[1] + east_m / M_PER_DEG[1]
    rest = f'<node id="6" lat="{CENTRE[0]}" lon="{longitude:.8f}">'
    rest += tag("highway", "crossing") + "</node>"
    rest += way("51", "2 1 3", *STREET) + way("52", "5 1 4", *STREET)
    path = write_osm(tmp_path, {k: (float(x), float(y)) for k, (x, y) in nodes.items()}, rest)

    told = [
        it.count
        for it in read_map(path, "urban").left_out
        if it.name.startswith("pedestrian crossing")
    ]
    assert told == [unbuilt] * unbuilt


def test_crosswalks_of_opendrive_are_the_only_crossings(tmp_path: Path) -> None:
    corners = ((3.5, 1.5), (-3.5, 1.5), (-3.5, -1.5), (3.5, -1.5), (3.5, 1.5))
    outline = "".join(f'<cornerLocal u="{u}" v="{v}" z="0"/>' for u, v in corners)
    walk = '<object id="7" type="crosswalk" s="47" t="0" hdg="1.5707963" zOffset="0">'
    text = (DATA / "junction.xodr").read_text(encoding="utf-8")
    objects = f"<objects>{walk}<outline>{outline}</outline></object></objects>"
    path = tmp_path / "walk.xodr"
    path.write_text(text.replace("  </road>", f"{objects}</road>", 1), encoding="utf-8")

    for land_use in ("urban", "rural"):
        middles = crossing_middles(read_road(path, land_use))

        # On the western street, which ends 10 m from the middle of the junction.
        assert len(middles) == 1
        assert middles[0] == pytest.approx((-8, 0), abs=4)


def test_a_piece_without_a_junction_is_cut_out_of_a_map() -> None:
    road = Road.model_validate(declaration("opendrive", "junction.xodr"))
    piece = MapFile(source="opendrive", file="junction.xodr", extent_m=((-60, -10), (-40, 10)))

    network = import_map(piece, road, DATA)

    paved = build_road(road.model_copy(update={"imported": network})).paved_area
    west, south, east, north = paved.bounds
    assert (west, south, north) == pytest.approx((-60, -5.5, 5.5), abs=0.05)
    assert east < 1


SIDEWALK = ("sidewalk", "both")
ONE_WAY_STREET = (("highway", "residential"), ("oneway", "yes"), ("name", "Rue d'Abbeville"))


def sides_with_sidewalks(path: Path) -> dict[str, str]:
    """The sides at which each street has a sidewalk: `left right`."""
    found = read_road(path, "urban").streets
    return {
        name: " ".join(
            side
            for side, strips in (("left", item.left_strips), ("right", item.right_strips))
            if any(strip.kind is StripKind.SIDEWALK for strip in strips)
        )
        for name, item in found.items()
    }


@pytest.mark.parametrize(
    ("tags", "sides"),
    [
        ((), "left right"),
        ((SIDEWALK,), "left right"),
        ((("sidewalk", "separate"),), "left right"),
        ((("sidewalk", "left"),), "left"),
        ((("sidewalk", "right"),), "right"),
        ((("sidewalk", "no"),), ""),
    ],
)
def test_a_one_way_street_of_a_town_has_sidewalks_at_both_sides(
    tags: tuple[tuple[str, str], ...], sides: str, tmp_path: Path
) -> None:
    nodes = {"1": (0.0, 0.0), "2": (0.0, 120.0), "3": (120.0, 0.0), "4": (-120.0, 0.0)}
    ways = way("51", "2 1", *ONE_WAY_STREET, *tags) + way("52", "3 1 4", *STREET)
    found = sides_with_sidewalks(write_osm(tmp_path, nodes, ways))
    assert found["rue_d_abbeville"] == sides
    assert {item for name, item in found.items() if "52" in name} == {"left right"}


def test_the_sidewalk_at_the_left_of_a_one_way_street_is_raised_and_reached_by_crossings(
    tmp_path: Path,
) -> None:
    nodes = {"1": (0.0, 0.0), "2": (0.0, 120.0), "3": (120.0, 0.0), "4": (-120.0, 0.0)}
    ways = way("51", "2 1", *ONE_WAY_STREET) + way("52", "3 1 4", *STREET)
    road = read_road(write_osm(tmp_path, nodes, ways), "urban")
    (street,) = (item for name, item in road.streets.items() if name == "rue_d_abbeville")
    raised = shapely.difference(road.paved_area, road.roadway_level_area)
    for strips in (street.left_strips, street.right_strips):
        walk = next(strip for strip in strips if strip.kind is StripKind.SIDEWALK)
        middle = street.points_at(60, (walk.inner_t + walk.outer_t) / 2)[:2]
        assert raised.contains(shapely.Point(middle))
    assert len(crossing_middles(road)) == 3


def test_halves_of_a_dual_carriageway_have_no_sidewalk_between_them(tmp_path: Path) -> None:
    nodes = {"1": (0.0, 0.0), "2": (200.0, 0.0), "3": (200.0, 12.0), "4": (0.0, 12.0)}
    half = (("highway", "primary"), ("oneway", "yes"), ("lanes", "2"))
    ways = way("51", "1 2", *half) + way("52", "3 4", *half)
    assert set(sides_with_sidewalks(write_osm(tmp_path, nodes, ways)).values()) == {"right"}


def test_streets_that_only_run_side_by_side_have_sidewalks_at_both_sides(tmp_path: Path) -> None:
    nodes = {"1": (0.0, 0.0), "2": (200.0, 0.0), "3": (200.0, 60.0), "4": (0.0, 60.0)}
    ways = way("51", "1 2", *ONE_WAY_STREET) + way("52", "3 4", *ONE_WAY_STREET)
    found = sides_with_sidewalks(write_osm(tmp_path, nodes, ways))
    assert set(found.values()) == {"left right"}


def test_paths_that_no_car_may_use_are_not_imported(tmp_path: Path) -> None:
    nodes = {"1": (0.0, 0.0), "2": (0.0, 120.0), "3": (120.0, 0.0), "4": (-120.0, 0.0)}
    for kind in ("footway", "pedestrian", "cycleway", "path"):
        ways = way("51", "2 1", ("highway", kind)) + way("52", "3 1 4", *STREET)
        road = read_road(write_osm(tmp_path, nodes, ways), "urban")
        assert road.paved_area.bounds[3] < 10, kind


def test_a_junction_of_several_nodes_has_a_short_name(tmp_path: Path) -> None:
    """Names of junctions are parts of ids of scenarios, which are limited."""
    nodes = {"1": (0.0, 0.0), "2": (8.0, 0.0), "3": (-120.0, 0.0), "4": (120.0, 0.0)}
    nodes |= {"5": (0.0, 120.0), "6": (8.0, -120.0)}
    ways = way("51", "3 1 2 4", *STREET) + way("52", "5 1", *STREET) + way("53", "6 2", *STREET)
    road = read_road(write_osm(tmp_path, nodes, ways), "urban")
    assert {item.begins for item in road.streets.values()} >= {"j1"}
    assert all(len(item.ends) < 3 for item in road.streets.values())
