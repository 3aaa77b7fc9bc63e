"""Names and keys of the original's configuration, for its own tools.

Its `generate_summary.py` reads them from `data_protocol.yaml`.
"""

from typing import Any

from advercity_dsl import Spec

ROADS = {
    "ui": "urban_intersection",
    "unj": "urban_non_junction",
    "ri": "rural_intersection",
    "rsnj": "rural_straight_non_junction",
    "rcnj": "rural_curved_non_junction",
}
WEATHERS = {
    "fog": "foggy",
    "heavy_rain": "hard_rain",
    "foggy_heavy_rain": "foggy_hard_rain",
}
"""The original's names by ours; ids missing here stay as they are."""
SPAWN_POINTS = {"vehicle": 2, "roadside_unit": 1}
"""Places around which the original spawns traffic, by kind of agent."""


def describe_as_original(spec: Spec) -> dict[str, str]:
    """Describe a scenario by the original's names of road, weather, time of day and density."""
    time = spec.weather.time
    weather = spec.weather.id.removesuffix(f"_{time}")
    return {
        "scenario": ROADS.get(spec.road.id, spec.road.id),
        "weather": WEATHERS.get(weather, weather),
        "time_of_day": time,
        "density": spec.density.id,
    }


def build_protocol(spec: Spec) -> dict[str, Any]:
    """Build `data_protocol.yaml`: the spec, with additional keys for the original's tools.

    They multiply the counts of one spawn point to get the numbers of vehicles and pedestrians.
    """
    names, vehicles, walkers = (
        describe_as_original(spec),
        spec.density.vehicles,
        spec.density.walkers,
    )
    document: dict[str, Any] = spec.model_dump(mode="json")
    agents: dict[str, list[dict[str, Any]]] = {kind: [] for kind in SPAWN_POINTS}
    for agent in spec.recorded_agents:
        agents[agent.place.kind].append({"name": agent.id, "id": agent.number})
    points = sum(count * len(agents[kind]) for kind, count in SPAWN_POINTS.items()) * vehicles
    return {
        **document,
        "dataset_config": {
            "scenario": names["scenario"],
            "weather": f"{names['weather']}_{names['time_of_day']}",
            "density": names["density"],
        },
        "scenario": {
            "num_vehicles": spec.demand.vehicles / points if points else 0,
            "num_walkers": spec.demand.walkers / walkers if walkers else 0,
            "rsu_list": agents["roadside_unit"],
            "single_cav_list": agents["vehicle"],
        },
        "density": {
            **document["density"],
            "vehicle_multiplier": vehicles,
            "walker_multiplier": walkers,
        },
    }
