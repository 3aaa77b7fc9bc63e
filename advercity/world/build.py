"""Puts a spec's world together: road, ground, surroundings, furniture, bodies."""

from functools import partial
from pathlib import Path

from advercity_dsl import Spec

from advercity.world import terrain
from advercity.world.assets import Shelf
from advercity.world.bodies import body
from advercity.world.furniture import furniture
from advercity.world.parking import parked_cars
from advercity.world.roads import built
from advercity.world.scene import World
from advercity.world.surroundings import surroundings


def build_world(spec: Spec, network: Path, shelf: Shelf | None = None) -> World:
    """The world of a spec, whose SUMO network is at `network`.

    It is a function of the spec alone, but for bodies whose models lie on the `shelf`: these look
    otherwise, at the same size.
    """
    road = built(spec.road)
    plateaus = terrain.plateaus(spec.road)
    ground_height = partial(terrain.ground_height, road.rims, plateaus=plateaus)
    around, street_lamps = surroundings(spec.road, ground_height, road.footprint)
    fixed, signal_lamps = furniture(spec.road, ground_height)
    bodies = {name: body(name, blueprint, shelf) for name, blueprint in spec.blueprints.items()}
    return World(
        id=spec.road.id,
        static=(
            *road.meshes,
            terrain.skirt(road.rims),
            terrain.ground(road.rims, road.footprint, plateaus),
            *around,
            *fixed,
            *parked_cars(spec.road, spec.blueprints, bodies, spec.conflicts),
        ),
        bodies=bodies,
        lanes=road.lanes,
        network=network,
        street_lamps=tuple(street_lamps),
        signal_lamps=tuple(signal_lamps),
    )
