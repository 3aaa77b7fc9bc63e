"""A declared road of two streets that cross at two levels."""

from typing import Any

from tests.roads.imported_roads import vehicle

_SIDE = [
    {"kind": "lane", "width_m": 3.5, "line": "solid_white"},
    {"kind": "sidewalk", "width_m": 2},
]


def declare_two_levels(high_m: float = 6.5) -> dict[str, Any]:
    """Declare a level street to the east and one to the north, which is so high above the other."""
    profile = ((0, 0), (120, high_m), (200, high_m), (320, 0))
    return {
        "kind": "road",
        "id": "levels",
        "land_use": "urban",
        "junction": "non_junction",
        "alignment": "straight",
        "profile": "non_level",
        "sections": {"two_lanes": {"axis_line": "broken_white", "left": _SIDE, "right": _SIDE}},
        "streets": {
            "low": _street("west", "east", [-120, 0], 0, 240),
            "high": _street("south", "north", [0, -160], 90, 320)
            | {"heights": [{"at_m": at, "z_m": z} for at, z in profile]},
        },
        "agents": {"cav1": vehicle((-100, -1.75), 0, (100, -1.75), "ego")},
        "traffic": {
            "vehicles_per_area": 1,
            "walkers": 0,
            "around_agent_m": 50,
            "around_path_m": 15,
            "classes": {"car": 1, "van": 0, "truck": 0, "bicycle": 0, "motorcycle": 0},
        },
    }


def _street(
    begins: str, ends: str, start_m: list[float], heading_deg: float, length_m: float
) -> dict[str, Any]:
    return {
        "begins": begins,
        "ends": ends,
        "start_m": start_m,
        "heading_deg": heading_deg,
        "path": [{"line_m": length_m}],
        "section": "two_lanes",
        "speed_limit_km_h": 50,
    }
