"""Roads that are imported from the maps in `tests/data/maps`."""

import shutil
from pathlib import Path
from typing import Any

import yaml
from advercity_dsl import Spec
from advercity_dsl.units import Point2

from advercity.compiler.crossing import compile_library

DATA = Path(__file__).parents[1] / "data/maps"


def vehicle(
    spawn: Point2, heading: float, destination: Point2, role: str = "other"
) -> dict[str, object]:
    return {
        "kind": "vehicle",
        "role": role,
        "spawn_m": list(spawn),
        "heading_deg": heading,
        "destination_m": list(destination),
        "max_speed_km_h": 40,
    }


def declaration(source: str, file: str, **more: object) -> dict[str, object]:
    """Declare a road from a map, without agents."""
    return {
        "kind": "road",
        "id": "imported",
        "land_use": "rural",
        "junction": "intersection",
        "alignment": "straight",
        "profile": "level",
        "imported": {"source": source, "file": file},
        "agents": {},
        "traffic": {
            "vehicles_per_area": 1,
            "walkers": 8,
            "crossing_share": 0.5,
            "around_agent_m": 50,
            "around_path_m": 15,
            "classes": {"car": 0.8, "van": 0.2, "truck": 0, "bicycle": 0, "motorcycle": 0},
        },
        **more,
    }


SUITE = {
    "kind": "suite",
    "id": "imports",
    "roads": "all",
    "weathers": ["clear_day"],
    "densities": ["sparse"],
    "rig": "adver_city",
    "catalogue": "adver_city",
    "timing": {"warm_up_ticks": 10, "max_ticks": 900},
}


BEND = declaration(
    "opendrive",
    "bend.xodr",
    agents={
        "cav1": vehicle((20, -1.75), 0, (125, 3), "ego"),
        "cav2": vehicle((138.26, 16.08), -137, (2, 1.75)),
    },
)


TWO_LEVELS = declaration(
    "opendrive",
    "two_levels.xodr",
    profile="non_level",
    agents={"cav1": vehicle((-60, -1.6), 0, (130, -1.6), "ego")},
)
"""A street that leads over another, 5.5 m above it and at 60 degrees to it."""


CROSSROADS = declaration(
    "osm",
    "crossroads.osm",
    origin_lat_deg=48,
    origin_lon_deg=11,
    land_use="urban",
    agents={
        "cav1": vehicle((1.6, -60), 90, (-60, 1.6), "ego"),
        "cav2": vehicle((-1.6, 70), -90, (-1.6, -185)),
        "cav3": vehicle((60, 1.6), 180, (1.6, 185)),
        "rsu": {"kind": "roadside_unit", "position_m": [12, -12, 6], "yaw_deg": 135},
    },
)


AT_JUNCTION: dict[str, Any] = {
    name: value for name, value in CROSSROADS.items() if name != "agents"
} | {
    "land_use": "urban",
    "at_junction": {
        "agents": {
            "cav1": {"kind": "vehicle", "role": "ego", "arm": "south"},
            "cav2": {
                "kind": "vehicle",
                "arm": "left",
                "turn": "right",
                "start_m": 60,
                "waits_s": 3,
            },
            "rsu": {"kind": "roadside_unit", "arm": "opposite"},
        }
    },
}
"""The crossroads with its agents placed by the arms of its signalised junction."""


def compiled_suite(
    library: Path, folder: Path, road: dict[str, object], **suite: object
) -> dict[str, Spec]:
    """Compile a suite of an imported road with the rig and catalogue of the library."""
    for kind, data in (("road", road), ("suite", SUITE | suite)):
        (folder / f"{kind}.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    for path in DATA.iterdir():
        shutil.copy(path, folder)
    return {spec.id: spec for spec in compile_library(library, folder, suite="imports")}


def compiled(library: Path, folder: Path, road: dict[str, object]) -> Spec:
    """Compile the spec of an imported road."""
    return compiled_suite(library, folder, road)["imported_clear_day_sparse"]
