"""Count the pedestrians who set foot on a roadway; vehicles yield to some of them."""

import numpy as np
import shapely
from advercity_dsl import Spec
from shapely.geometry.base import BaseGeometry

from advercity.frames import Trace
from advercity.roads.road_network import build_road


def find_roadway(spec: Spec) -> BaseGeometry:
    """Find the roadway of a road, in the plan frame."""
    roadway = build_road(spec.road).roadway_level_area
    shapely.prepare(roadway)
    return roadway


def find_crossing_people(trace: Trace, roadway: BaseGeometry) -> set[int]:
    """Find the ids of people who set foot on a roadway, from `find_roadway`, at any tick."""
    on_foot = np.array([actor.actor_class == "pedestrian" for actor in trace.actors], dtype=bool)
    rows = trace.states[on_foot[trace.states["actor"]]]
    rows = rows[shapely.contains_xy(roadway, rows["x"], rows["y"])]
    return {trace.actors[index].id for index in np.unique(rows["actor"])}


def measure_crossing_share(spec: Spec, trace: Trace, roadway: BaseGeometry) -> float | None:
    """Measure the fraction of the background pedestrians who set foot on a roadway.

    Args:
        spec: The scenario, in the plan frame.
        trace: Its traffic, in the plan frame.
        roadway: From `find_roadway`.

    Returns:
        The fraction; None without background pedestrians.
    """
    staged = {actor.number for conflict in spec.conflicts for actor in conflict.actors}
    people = {actor.id for actor in trace.actors if actor.actor_class == "pedestrian"} - staged
    return len(people & find_crossing_people(trace, roadway)) / len(people) if people else None
