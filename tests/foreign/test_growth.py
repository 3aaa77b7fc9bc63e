"""The time that every reader of files takes grows with their size, and no faster."""

import gc
import json
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from advercity_benchmark.predictions import load_predictions
from advercity_dsl import MapFile, Road
from advercity_dsl.road import MapSource

from advercity.array_files import load_arrays
from advercity.assets.model_files import ModelPart, read_glb, read_obj, to_glb
from advercity.compiler.library import load_declaration
from advercity.compiler.recorded_roads import load_recorded_scenario, load_recorded_table
from advercity.dataset.cloud_files import encode_ply, read_foreign_pcd, read_ply
from advercity.documents import parse_json, parse_yaml
from advercity.errors import AdvercityError
from advercity.foreign.ledger import Ledger
from advercity.foreign.xml_documents import parse_xml
from advercity.image_files import decode_image
from advercity.recordings.sumo_scenario import read_sumo_scenario
from advercity.roads.map_import import PLANNERS
from tests.recordings.recorded_files import (
    format_vertex,
    write_openscenario,
    write_street,
)
from tests.roads.imported_roads import declaration
from tests.roads.lanelet2_maps import LaneletMap
from tests.roads.opendrive_maps import lane, linked, road, section
from tests.roads.sumo_networks import build_crossing_network
from tests.traffic.sumo_scenario_files import ROUTES, write_sumo_scenario

Read = Callable[[], object]
FILE = Path("file")


def plan(source: MapSource, text: str) -> Read:
    root = parse_xml(text.encode())
    file = MapFile(source=source, file="map")
    declared = declaration(source, "map", origin_lat_deg=48.0, origin_lon_deg=11.0)
    described = Road.model_validate(declared)
    return lambda: PLANNERS[source](root, described, file, Ledger())


def plan_roads(folder: Path, count: int) -> Read:
    """A chain of roads of OpenDRIVE, 50 m each."""
    lanes = section(0.0, lane(1, "driving", 3.5), lane(0, "none"), lane(-1, "driving", 3.5))
    parts = [
        road(
            str(number),
            50.0,
            lanes,
            start=(50.0 * number, 0.0, 0.0),
            link=(linked("predecessor", "road", str(number - 1), "end") if number else "")
            + (linked("successor", "road", str(number + 1), "start") if number + 1 < count else ""),
        )
        for number in range(count)
    ]
    return plan("opendrive", f"<OpenDRIVE><header/>{''.join(parts)}</OpenDRIVE>")


def plan_ways(folder: Path, count: int) -> Read:
    """Streets of OpenStreetMap, one behind the other."""
    nodes = [f'<node id="{i + 1}" lat="48.0" lon="{11 + i * 5e-4:.6f}"/>' for i in range(count + 1)]
    tags = '<tag k="highway" v="residential"/><tag k="lanes:psv" v="|designated"/>'
    ways = [
        f'<way id="{9000 + i}"><nd ref="{i + 1}"/><nd ref="{i + 2}"/>{tags}</way>'
        for i in range(count)
    ]
    return plan("osm", f'<osm version="0.6">{"".join(nodes + ways)}</osm>')


def plan_lanelets(folder: Path, count: int) -> Read:
    """Lanelets, one behind the other."""
    lanelets = LaneletMap()
    for number in range(count):
        ends = 30.0 * number, 30.0 * (number + 1)
        left, right = ([(x, y) for x in ends] for y in (1.75, -1.75))
        lanelets.lane(left, right, location="urban")
    return plan("lanelet2", lanelets.write())


def plan_network(folder: Path, count: int) -> Read:
    """A network of SUMO whose lanes have many points."""
    points = " ".join(f"{i / 100:.2f},0.00" for i in range(count))
    return plan("sumo", build_crossing_network().replace('shape="', f'shape="{points} '))


def read_rows(folder: Path, count: int) -> Read:
    head = "id,class,time_s,x_m,y_m,heading_deg,length_m,width_m,height_m\n"
    rows = [f"{i // 50},car,{i % 50 / 10},{i % 50},{i // 50},0,4.6,1.8,1.5\n" for i in range(count)]
    (folder / "table.csv").write_text(head + "".join(rows))
    return lambda: load_recorded_table(folder / "table.csv")


def read_vertices(folder: Path, count: int) -> Read:
    write_street(folder)
    along = "".join(format_vertex(t, 48.6 + 5 * t, -1.75, 0.0) for t in np.linspace(0, 4, count))
    path = write_openscenario(folder)
    whole = path.read_text()
    before, begin, after = whole.partition("<Polyline>")
    path.write_text(f"{before}{begin}{along}</Polyline>{after.partition('</Polyline>')[2]}")
    return lambda: load_recorded_scenario(path)


def read_routes(folder: Path, count: int) -> Read:
    one = '<vehicle id="v{0}" type="plain" route="north" depart="{0}"/>'
    more = "".join(one.format(number) for number in range(100, 100 + count))
    path = write_sumo_scenario(folder, routes=ROUTES.replace("</routes>", f"{more}</routes>"))
    return lambda: read_sumo_scenario(path, Ledger())


def read_lines(folder: Path, count: int) -> Read:
    header = {"format": "advercity-predictions", "version": 1}
    line = {"scenario": "s", "boxes": [[1, 2, 3, 4, 2, 2, 0]], "scores": [0.5]}
    lines = [json.dumps({"frame": number, **line}) for number in range(count)]
    (folder / "p.jsonl").write_text("\n".join((json.dumps(header), *lines)))
    return lambda: load_predictions(folder / "p.jsonl")


def read_points(folder: Path, count: int) -> Read:
    names = " ".join(f"f{number}" for number in range(count))
    head = f"VERSION .7\nFIELDS x y z {names}\nSIZE 4 4 4{' 4' * count}\nTYPE F F F{' F' * count}\n"
    text = f"{head}WIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA binary\n"
    (folder / "c.pcd").write_bytes(text.encode() + bytes(4 * (3 + count)))
    return lambda: read_foreign_pcd(folder / "c.pcd")


def read_ply_points(folder: Path, count: int) -> Read:
    cloud = encode_ply(np.ones((count, 3)), intensity=np.ones(count))
    (folder / "c.ply").write_bytes(cloud)
    return lambda: read_ply(folder / "c.ply")


def read_faces(folder: Path, count: int) -> Read:
    text = "".join(f"v {i} 0 0\nv {i} 1 0\nv {i} 0 1\nf -3 -2 -1\n" for i in range(count))
    return lambda: read_obj(text.encode(), {})


def read_members(folder: Path, count: int) -> Read:
    arrays = {f"a{number}": np.zeros(1) for number in range(count)}
    np.savez(folder / "a.npz", **arrays)  # pyright: ignore[reportArgumentType]
    return lambda: load_arrays(folder / "a.npz", max_bytes=1 << 30)


def read_triangles(folder: Path, count: int) -> Read:
    corners = np.random.default_rng(1).normal(size=(3 * count, 3))
    glb = to_glb([ModelPart("car_paint_red", corners, np.arange(3 * count).reshape(-1, 3))])
    return lambda: read_glb(glb, "car.glb")


def read_meshes(folder: Path, count: int) -> Read:
    triangle = np.array([[0.0, 1.0, 2.0]]), np.eye(3)
    glb = to_glb(
        [ModelPart(f"m{i}", triangle[1] + i, triangle[0].astype(int)) for i in range(count)]
    )
    return lambda: read_glb(glb, "car.glb")


def read_pixels(folder: Path, count: int) -> Read:
    noise = np.random.default_rng(1).integers(0, 256, (count, 500, 3), np.uint8)
    png = cv2.imencode(".png", noise)[1].tobytes()
    return lambda: decode_image(png, cv2.IMREAD_COLOR_RGB)


def read_chain(folder: Path, count: int) -> Read:
    """A chain of cameras of Kalibr, the last of which a rig names."""
    camera = (
        "  camera_model: pinhole\n  intrinsics: [461.6, 460.1, 362.7, 246.0]\n"
        "  distortion_model: radtan\n  distortion_coeffs: [-0.27, 0.067, 0, 0]\n"
        "  resolution: [752, 480]\n"
    )
    (folder / "chain.yaml").write_text("".join(f"cam{i}:\n{camera}" for i in range(count)))
    named = (
        f"{{calibration: chain.yaml, calibrated_camera: cam{count - 1}, mounts: [{{z_m: 1.5}}]}}"
    )
    rig = folder / "rig.yaml"
    rig.write_text(f"kind: rig\nid: chain\nvehicle:\n  camera: {named}\n  lidar: {{}}\n")
    return lambda: load_declaration(rig)


def read_expressions(folder: Path, count: int) -> Read:
    """Vertices of OpenSCENARIO at places that expressions compute of as many parameters."""
    write_street(folder)
    path = write_openscenario(folder)
    numbers = range(count)
    declared = "".join(
        f'<ParameterDeclaration name="p{i}" parameterType="double" value="{48 + 20 * i / count}"/>'
        for i in numbers
    )
    along = "".join(format_vertex(4 * i / (count - 1), i, -1.75, 0.0) for i in numbers)
    for i in numbers:
        along = along.replace(f'x="{i:.6f}"', f'x="${{($p{i} + 1) - 1}}"')
    before, begin, after = path.read_text().partition("<Polyline>")
    text = f"{before}{begin}{along}</Polyline>{after.partition('</Polyline>')[2]}"
    path.write_text(text.replace("</ParameterDeclarations>", f"{declared}</ParameterDeclarations>"))
    return lambda: load_recorded_scenario(path)


GROWING: dict[str, tuple[int, Callable[[Path, int], Read]]] = {
    "items of YAML": (1000, lambda _, n: lambda: parse_yaml("- {a: 1}\n" * n, FILE)),
    "a text of YAML": (60_000, lambda _, n: lambda: parse_yaml('a: "' + r"\n" * n + '"', FILE)),
    "brackets of YAML": (5000, lambda _, n: lambda: parse_yaml("[" * n, FILE)),
    "items of JSON": (20_000, lambda _, n: lambda: parse_json("[" + "{}, " * n + "1]", FILE)),
    "elements of XML": (
        10_000,
        lambda _, n: lambda: parse_xml(b"<a>" + b"<b c='1'/>" * n + b"</a>"),
    ),
    "depth of XML": (5000, lambda _, n: lambda: parse_xml(b"<a>" * n + b"</a>" * n)),
    "roads of OpenDRIVE": (15, plan_roads),
    "ways of OpenStreetMap": (150, plan_ways),
    "lanelets of Lanelet2": (30, plan_lanelets),
    "points of a SUMO network": (100, plan_network),
    "routes of a SUMO scenario": (300, read_routes),
    "rows of a recorded table": (1000, read_rows),
    "vertices of OpenSCENARIO": (100, read_vertices),
    "lines of predictions": (500, read_lines),
    "fields of a PCD": (200, read_points),
    "points of a PLY": (3000, read_ply_points),
    "faces of an OBJ": (1000, read_faces),
    "arrays of an NPZ": (20, read_members),
    "triangles of a GLB": (3000, read_triangles),
    "meshes of a GLB": (10, read_meshes),
    "rows of a PNG": (100, read_pixels),
    "cameras of a calibration": (60, read_chain),
    "expressions of OpenSCENARIO": (50, read_expressions),
}
"""Files of a parser by a size at which it takes some milliseconds."""


@pytest.mark.parametrize("kind", GROWING)
def test_four_times_the_size_takes_at_most_eight_times_as_long(kind: str, tmp_path: Path) -> None:
    def measure_s(count: int) -> float:
        folder = tmp_path / str(count)
        folder.mkdir()
        read = build(folder, count)
        times_s: list[float] = []
        gc.collect()
        for _ in range(3):
            begin_s = time.process_time()
            try:
                read()
            except AdvercityError:
                assert "depth" in kind or "brackets" in kind
            times_s.append(time.process_time() - begin_s)
        return min(times_s)

    count, build = GROWING[kind]
    small_s, large_s = measure_s(count), measure_s(4 * count)
    # Linear readers take 4 times as long, quadratic ones 16 times.
    assert large_s < 8 * max(small_s, 2e-3)
