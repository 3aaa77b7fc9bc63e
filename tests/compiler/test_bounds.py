import os
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from advercity.compiler.crossing import compile_library
from advercity.compiler.schema import SCHEMA_MODELS, build_schema
from advercity.errors import InputError
from tests.builders import Write


def iterate_schemas(data: Any, path: str) -> Iterator[tuple[str, dict[str, Any]]]:
    if isinstance(data, dict):
        yield path, data
        for key, value in data.items():
            if key not in ("default", "examples", "enum"):
                yield from iterate_schemas(value, f"{path}.{key}")
    elif isinstance(data, list):
        for index, value in enumerate(data):
            yield from iterate_schemas(value, f"{path}.{index}")


@pytest.mark.parametrize("kind", SCHEMA_MODELS)
def test_every_number_and_list_of_a_schema_is_bounded(kind: str) -> None:
    unbounded: list[str] = []
    for path, schema in iterate_schemas(build_schema(kind), kind):
        if {"enum", "const"} & {*schema, *schema.get("propertyNames", {})}:
            continue
        match schema.get("type"):
            case "number" | "integer" | ["number", "string"]:
                low = schema.keys() & {"minimum", "exclusiveMinimum"}
                bounded = low and schema.keys() & {"maximum", "exclusiveMaximum"}
            case "array":
                bounded = "maxItems" in schema
            case "object":
                bounded = "maxProperties" in schema or "properties" in schema
            case _:
                bounded = True
        if not bounded and path != f"{kind}.properties.extends.anyOf.1":
            unbounded.append(path)
    assert unbounded == []


@pytest.mark.parametrize(
    ("kind", "old", "new", "message"),
    [
        ("road", "line_m: 200", "line_m: 1.0e9", "outside the range of 0.001 to 5000 m"),
        ("road", "line_m: 200", "line_m: 1e-300", "outside the range of 0.001 to 5000 m"),
        ("road", "{line_m: 200}", "{points_m: [[2e4, 0]]}", "makes the site 20000 m wide"),
        ("road", "spawn_m: [10,", "spawn_m: [1e308,", "outside the range of -10000000 to"),
        ("road", "heading_deg: 0\n    dest", "heading_deg: 1e308\n    dest", "two full turns"),
        ("road", "car: 0.5", "car: -0.5", "-0.5 is outside the range of 0 to 1"),
        (
            "road",
            "around_path_m: 10",
            "around_path_m: 1e308",
            "outside the range of 0.001 to 10000",
        ),
        (
            "weather",
            "id:",
            "fog: {mor_m: 1e99999999}\nid:",
            "'1e99999999' is too large for a number",
        ),
        ("weather", "id:", "fog: {mor_m: 1e999 km}\nid:", "'1e999 km' is too large for a number"),
        ("weather", "id:", "fog: {mor_m: }\nid:", "fog.mor_m: the value is missing"),
        ("weather", "id:", "fog:\nid:", "fog: the value is missing"),
        ("suite", "id:", f"seeds: {{traffic: {'9' * 40}}}\nid:", "range of 0 to 4294967295"),
        ("suite", "id:", f"seeds: {{traffic: {'9' * 4000}}}\nid:", "range of 0 to 4294967295"),
        ("rig", "mounts: [{x_m: 1", "mounts: [{x_m: 1e308", "outside the range of -100 to 100 m"),
        ("rig", "lidar:", "gnss: {altitude_noise_m: 1e308}, lidar:", "no receiver errs by"),
        ("road", "traffic:", f"surroundings: [{'1, ' * 90_000}]\ntraffic:", "and 100 more errors"),
        ("road", "traffic:", f"x: [{'1, ' * 110_000}]\ntraffic:", "holds more than 100000 values"),
        ("road", "traffic:", f"x: [{'1, ' * 1_500_000}]\ntraffic:", "is larger than 4 MB"),
        (
            *("road", "traffic:"),
            "surroundings: [{kind: crops, area_m: [[0, 0], [9000, 9000]]}]\ntraffic:",
            "has 81 km2; the limit is 1 km2",
        ),
        (
            *("density", "vehicles: 1", "vehicles: 20"),
            "20 times the demand of road 'lane': 320 vehicles do not fit on 400 m of lanes, which"
            " have room for 50, 8 m each; 'vehicles' is a factor",
        ),
    ],
    ids=range(20),
)
def test_absurd_values_are_refused_at_once(
    kind: str, old: str, new: str, message: str, write: Write
) -> None:
    folder = write()
    path = folder / f"{kind}.yaml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    begin_s = time.process_time()
    with pytest.raises(InputError) as caught:
        compile_library(folder)
    assert time.process_time() - begin_s < 5
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


def write_huge_file(path: Path) -> None:
    """Writes a sparse file of 1 TB."""
    path.touch()
    os.truncate(path, 1 << 40)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (os.mkfifo, "'car.glb' is not a regular file"),
        (os.mkdir, "'car.glb' is a folder"),
        (partial(os.symlink, "/dev/zero"), "'car.glb' is not a regular file"),
        (write_huge_file, "'car.glb' is larger than 200"),
        (partial(Path.write_text, data="solid"), "'car.glb' is not a GLB file"),
    ],
    ids=["pipe", "folder", "device", "huge", "text"],
)
def test_models_that_are_no_regular_files_of_limited_size_are_refused(
    make: Callable[[Path], object], message: str, write: Write
) -> None:
    folder = write()
    path = folder / "catalogue.yaml"
    model = "model: {file: car.glb, author: Me, licence: CC0-1.0}, actor_class: car"
    path.write_text(path.read_text().replace("actor_class: car", model, 1))
    make(folder / "car.glb")
    with pytest.raises(InputError) as caught:
        compile_library(folder)
    assert message in str(caught.value)
    assert f"{path}:" in str(caught.value)
