"""A road on which traffic drives on the left, in an asymmetric world."""

from typing import Any

from advercity_dsl import Road

NEAR_SIDE: list[dict[str, Any]] = [
    {"kind": "lane", "width_m": 3.5, "line": "solid_white"},
    {"kind": "parking", "width_m": 2.5},
    {"kind": "sidewalk", "width_m": 3},
]
FAR_SIDE: list[dict[str, Any]] = [
    {"kind": "lane", "width_m": 3, "line": "solid_white"},
    {"kind": "sidewalk", "width_m": 2},
]
AXIS_Y_M = 10.0
STREET: dict[str, Any] = {
    "kind": "road",
    "id": "street",
    "land_use": "urban",
    "junction": "non_junction",
    "alignment": "curved",
    "profile": "level",
    "driving_side": "left",
    "sections": {
        # On the left of the axis are the lanes that run along it.
        "two_lanes": {"axis_line": "broken_white", "left": NEAR_SIDE, "right": FAR_SIDE}
    },
    "streets": {
        "main": {
            "begins": "west",
            "ends": "south",
            "start_m": [-120, AXIS_Y_M],
            "heading_deg": 0,
            "path": [{"line_m": 160}, {"arc_m": 60, "radius_m": 60, "turn": "right"}],
            "section": "two_lanes",
            "speed_limit_km_h": 30,
        }
    },
    "surroundings": [
        {"kind": "parked_cars", "beside": {"street": "main", "side": "left", "from_m": 5}},
        {"kind": "speed_sign", "beside": {"street": "main", "side": "left", "from_m": 60}},
        {"kind": "sign", "sign": "curve_right", "beside": {"street": "main", "side": "left"}},
        {"kind": "lamp", "at_m": [[-50, 20]]},
        {
            "kind": "buildings",
            "line_m": [[-60, 30], [-20, 30], [-20, 45], [-60, 45]],
            "use": "commercial",
        },
        {
            "kind": "furniture",
            "beside": {"street": "main", "side": "right", "to_m": 150},
            "per_100_m": {"hoarding": 3, "bench": 2},
        },
        {"kind": "trees", "area_m": [[-100, -40], [-60, -20]]},
    ],
    "agents": {
        "cav1": {
            "kind": "vehicle",
            "role": "ego",
            "spawn_m": [-100, AXIS_Y_M + 1.75],
            "heading_deg": 0,
            "destination_m": [60, AXIS_Y_M - 3],
            "max_speed_km_h": 40,
        },
        "cav2": {
            "kind": "vehicle",
            "spawn_m": [0, AXIS_Y_M - 1.5],
            "heading_deg": 180,
            "destination_m": [-110, AXIS_Y_M - 1.5],
            "max_speed_km_h": 40,
        },
        "rsu": {"kind": "roadside_unit", "position_m": [30, 18, 6], "yaw_deg": 200, "roll_deg": 2},
    },
    "traffic": {
        "vehicles_per_area": 1,
        "walkers": 6,
        "around_agent_m": 50,
        "around_path_m": 10,
        "classes": {"car": 1, "van": 0, "truck": 0, "bicycle": 0, "motorcycle": 0},
    },
}


def build_street(**changes: object) -> Road:
    """Build the road, validated."""
    return Road.model_validate(STREET | changes)
