"""Builds the world of a spec: road, ground, surroundings and street furniture."""

from pathlib import Path

import shapely
from advercity_dsl import Spec

from advercity.geometry.mesh import build_meshes
from advercity.roads.ironwork import place_ironwork
from advercity.roads.pavement_repairs import place_repairs
from advercity.roads.plan_frame import to_plan_spec
from advercity.roads.road_inlays import build_inlay_meshes
from advercity.roads.road_network import build_road
from advercity.scene.decks import (
    build_deck_meshes,
    cut_ground_edges,
    find_cuttings,
    find_decks,
    find_paved_ground,
)
from advercity.scene.mirrored_world import mirror_world
from advercity.scene.seasons import apply_season
from advercity.scene.street_furniture import build_street_furniture
from advercity.scene.surroundings import build_surroundings
from advercity.scene.terrain import GroundModel, build_ground, build_skirt, find_plateaus
from advercity.scene.verges import build_street_plants, build_verges
from advercity.world import World


def build_world(spec: Spec, network: Path) -> World:
    """Build the world of a spec without the bodies of its actors; takes some seconds.

    It depends on the road alone. `network` is in the plan frame.
    """
    plan = _build_plan_world(to_plan_spec(spec), network)
    return mirror_world(plan) if spec.road.is_left_hand else plan


def _build_plan_world(spec: Spec, network: Path) -> World:
    road = build_road(spec.road)
    decks = find_decks(road.lanes)
    edges = cut_ground_edges(road.paved_edges, decks)
    ground = GroundModel.from_edges(edges, find_plateaus(spec.road), find_cuttings(decks))
    surroundings, street_lamps, open_ground = build_surroundings(
        road, ground.height_at, road.paved_area
    )
    paving, roadway = road.meshes, road.roadway_level_area
    ironwork = place_ironwork(road.lanes, spec.road.id)
    reserved = shapely.union_all([item.outline for item in ironwork])
    inlays = [*ironwork, *place_repairs(road.lanes, spec.road.id, reserved)]
    plants = build_verges(roadway, open_ground, spec.road.id)
    plants += build_street_plants(paving, roadway, spec.road.id)
    verges = build_meshes(plants, "verge_")
    skirt = build_skirt(edges)
    earth = build_ground(ground, find_paved_ground(road.paved_area, decks))
    furniture, signal_lamps = build_street_furniture(road, ground.height_at)
    return World(
        id=spec.road.id,
        static=(
            *apply_season([*paving, skirt, earth], open_ground.season),
            *build_inlay_meshes(inlays, paving),
            *build_deck_meshes(decks, ground.height_at),
            *surroundings,
            *apply_season(verges, open_ground.season),
            *furniture,
        ),
        bodies={},
        lanes=road.lanes,
        network=network,
        street_lamps=tuple(street_lamps),
        signal_lamps=tuple(signal_lamps),
    )
