"""What an OpenStreetMap extract has beside its streets is drawn where it is."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import yaml
from advercity_dsl import Road

from advercity.compiler.library import load_declaration
from advercity.geometry.mesh import Mesh
from advercity.rendering.panes import PANE_MATERIALS
from advercity.roads.road_network import build_road
from advercity.scene.surroundings import build_surroundings
from advercity.scene.terrain import GroundModel, build_ground
from advercity.semantics import Semantic
from tests.roads.imported_roads import CROSSROADS, DATA
from tests.roads.probing import looking_down

M_PER_DEG = (111_200, 74_625)
"""Metres of a degree of latitude and of longitude at 48 degrees north."""
L_SHAPE = [(30, 20), (60, 20), (60, 35), (45, 35), (45, 60), (30, 60)]
HOUSE = [(-50, 20), (-38, 20), (-38, 28), (-50, 28)]
POND = [(30, -60), (60, -60), (60, -30), (30, -30)]
FIELD = [(-90, -90), (-40, -90), (-40, -40), (-90, -40)]


class Extract:
    """The crossroads with more nodes and ways, at places in metres."""

    def __init__(self) -> None:
        self.nodes: list[str] = []
        self.ways: list[str] = []

    def add_node(self, at: tuple[float, float], **tags: str) -> str:
        name = str(1000 + len(self.nodes))
        latitude, longitude = 48 + at[1] / M_PER_DEG[0], 11 + at[0] / M_PER_DEG[1]
        place = f'lat="{latitude:.8f}" lon="{longitude:.8f}"'
        self.nodes.append(f'<node id="{name}" {place}>{write_tags(tags)}</node>')
        return name

    def add_way(self, points: Sequence[tuple[float, float]], **tags: str) -> None:
        names = [self.add_node(point) for point in points]
        if tags.get("barrier") is None:
            names.append(names[0])
        refs = "".join(f'<nd ref="{name}"/>' for name in names)
        self.ways.append(f'<way id="{len(self.ways) + 100}">{refs}{write_tags(tags)}</way>')

    def write(self, folder: Path) -> None:
        text = (DATA / "crossroads.osm").read_text(encoding="utf-8")
        text = text.replace("  <way id=", "".join(self.nodes) + "<way id=", 1)
        text = text.replace("</osm>", "".join(self.ways) + "</osm>")
        (folder / "crossroads.osm").write_text(text, encoding="utf-8")


def write_tags(tags: dict[str, str]) -> str:
    return "".join(f'<tag k="{key.replace("__", ":")}" v="{v}"/>' for key, v in tags.items())


def load_road(extract: Extract, folder: Path, **more: object) -> Road:
    extract.write(folder)
    (folder / "road.yaml").write_text(yaml.safe_dump(CROSSROADS | more), encoding="utf-8")
    road = load_declaration(folder / "road.yaml").declaration
    assert isinstance(road, Road)
    return road


def build_meshes(road: Road) -> list[Mesh]:
    network = build_road(road)
    ground = GroundModel.from_edges(network.paved_edges, [])
    meshes, *_ = build_surroundings(network, ground.height_at, network.paved_area)
    return [*network.meshes, *meshes, build_ground(ground, network.paved_area)]


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Road:
    extract = Extract()
    extract.add_way(L_SHAPE, building="yes", building__levels="3", roof__shape="flat")
    extract.add_way(HOUSE, building="house", height="7", roof__shape="gabled")
    extract.add_way(POND, natural="water")
    extract.add_way(FIELD, landuse="farmland")
    extract.add_way([(-30, 12), (30, 12)], barrier="wall", height="2.5 m")
    extract.add_node((20, -9), natural="tree")
    extract.add_node((25, 1), natural="tree")
    extract.add_node((-20, -8), highway="street_lamp")
    return load_road(extract, tmp_path_factory.mktemp("town"))


def test_buildings_have_the_outline_height_and_roof_of_the_map(town: Road) -> None:
    below = looking_down(build_meshes(town))
    x, y = np.meshgrid(np.linspace(31, 44, 14), np.linspace(21, 59, 39))

    wing = below(np.column_stack([x.ravel(), y.ravel()]))
    court = below(np.array([[50.0, 40.0], [58.0, 55.0]]))
    ridge, eaves = below(np.array([[-44.0, 24.0], [-44.0, 20.1]]))[0]

    assert (wing[1] == Semantic.BUILDING.value).all()
    # Three storeys of 3.1 m; the ground is not quite level.
    np.testing.assert_allclose(wing[0], 9.3, atol=0.6)
    assert (court[1] == Semantic.TERRAIN.value).all()
    # The roof rises by three quarters of 4 m to the ridge, which is at 7 m.
    assert ridge == pytest.approx(7, abs=0.5)
    assert ridge - eaves == pytest.approx(3, abs=0.4)


def test_water_and_fields_fill_their_outlines(town: Road) -> None:
    below = looking_down(build_meshes(town))

    pond = below(np.array([[35.0, -55.0], [55.0, -35.0]]))[1]
    field = below(np.array([[-80.0, -80.0], [-50.0, -50.0]]))[1]
    beyond = below(np.array([[70.0, -45.0], [-30.0, -60.0]]))[1]

    assert (pond == Semantic.WATER.value).all()
    assert (field == Semantic.VEGETATION.value).all()
    assert (beyond == Semantic.TERRAIN.value).all()


def test_what_the_map_has_on_paving_is_left_out(town: Road) -> None:
    kinds = {item.kind.value: item for item in town.surroundings}

    assert kinds["trees"].at_m == ((20.0, -9.0),)
    assert kinds["lamp"].at_m == ((-20.0, -8.0),)
    walls = [item.line_m for item in town.surroundings if item.kind == "wall"]
    ends = sorted(abs(x) for line in walls for x, _ in line)
    # The wall crosses the street to the north, which is interrupted there.
    assert len(walls) == 2
    assert ends[2:] == [30.0, 30.0]
    assert 5 < ends[0] < 12


def test_land_use_and_tags_of_buildings_choose_their_use(tmp_path: Path) -> None:
    """The supermarket on industrial land is a shop by its own tag; a garage has no use."""
    extract = Extract()
    extract.add_way([(5, 5), (120, 5), (120, 120), (5, 120)], landuse="industrial")
    extract.add_way(L_SHAPE, building="yes", height="7")
    extract.add_way([(70, 20), (90, 20), (90, 50), (70, 50)], building="supermarket")
    extract.add_way([(100, 20), (104, 20), (104, 24), (100, 24)], building="garage")
    extract.add_way(HOUSE, building="yes")

    found = load_road(extract, tmp_path).surroundings

    uses = [item.use for item in found if item.kind == "buildings"]
    assert uses == ["industrial", "commercial", None, None]


@pytest.mark.parametrize(
    ("use", "lowest_m", "usual_m"), [("yes", 0.9, 4), ("retail", 0.5, 4), ("industrial", 5.3, 6)]
)
def test_shops_have_low_panes_and_halls_have_them_below_the_eaves(
    tmp_path: Path, use: str, lowest_m: float, usual_m: float
) -> None:
    """Of 7 m: sills at 0.9 and 0.5 m, or 1.2 m of glass and 0.5 m of wall below the eaves."""
    extract = Extract()
    extract.add_way([(8, 8), (40, 8), (40, 30), (8, 30)], building=use, height="7")
    network = build_road(load_road(extract, tmp_path))

    meshes, *_ = build_surroundings(network, lambda at: np.zeros(len(at)), network.paved_area)

    panes = [mesh for mesh in meshes if mesh.material in PANE_MATERIALS]
    heights_m = np.concatenate([mesh.vertices[:, 2] for mesh in panes])
    # The panes of a door are lower.
    assert np.quantile(heights_m, 0.03) == pytest.approx(lowest_m, abs=0.2)
    assert np.median(heights_m) == pytest.approx(usual_m, abs=1.5)


def test_a_style_adds_only_what_the_map_lacks(tmp_path: Path) -> None:
    extract = Extract()
    extract.add_way(L_SHAPE, building="yes")

    road = load_road(extract, tmp_path, style="residential")

    kinds = [item.kind.value for item in road.surroundings]
    assert kinds.count("buildings") == 1
    assert "houses" not in kinds
    assert {"trees", "lamp"} <= set(kinds)


def test_an_extract_with_too_much_in_it_says_how_to_cut_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from advercity.compiler import map_surroundings
    from advercity.errors import InputError

    extract = Extract()
    extract.add_way(L_SHAPE, building="yes")
    extract.add_way(HOUSE, building="yes")
    monkeypatch.setattr(map_surroundings, "MAX_SURROUNDINGS", 1)

    with pytest.raises(InputError, match=r"has 2 things near its streets.*`extent_m`"):
        load_road(extract, tmp_path)
