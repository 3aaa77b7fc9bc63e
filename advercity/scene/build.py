"""Puts a spec's world together: road, ground, surroundings, furniture, bodies."""

from functools import partial
from pathlib import Path

from advercity_dsl import Spec

from advercity.assets.bodies import build_body
from advercity.assets.model_store import ModelStore
from advercity.roads.road_network import build_road
from advercity.scene import terrain
from advercity.scene.parking import build_parked_cars
from advercity.scene.street_furniture import build_street_furniture
from advercity.scene.surroundings import build_surroundings
from advercity.world import World


def build_world(spec: Spec, network: Path, model_store: ModelStore | None = None) -> World:
    """The world of a spec, whose SUMO network is at `network`.

    It is a function of the spec alone, but for bodies whose models lie on the `shelf`: these look
    otherwise, at the same size.
    """
    road = build_road(spec.road)
    plateaus = terrain.find_plateaus(spec.road)
    ground_height = partial(terrain.compute_ground_height, road.paved_edges, plateaus=plateaus)
    around, street_lamps = build_surroundings(road, ground_height, road.paved_area)
    fixed, signal_lamps = build_street_furniture(road, ground_height)
    bodies = {
        name: build_body(name, blueprint, model_store)
        for name, blueprint in spec.blueprints.items()
    }
    return World(
        id=spec.road.id,
        static=(
            *road.meshes,
            terrain.build_skirt(road.paved_edges),
            terrain.build_ground(road.paved_edges, road.paved_area, plateaus),
            *around,
            *fixed,
            *build_parked_cars(road, spec.blueprints, bodies, spec.conflicts),
        ),
        bodies=bodies,
        lanes=road.lanes,
        network=network,
        street_lamps=tuple(street_lamps),
        signal_lamps=tuple(signal_lamps),
    )
