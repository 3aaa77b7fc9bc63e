"""What more is known of every annotated object, in a file that no loader of OPV2V opens.

They parse `<frame>.yaml` in pure Python several times over, so it stays short and this lies beside
it. Vectors are left-handed as there; boxes are in pixels, counted from the left upper corner.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from advercity.dataset.annotation import Annotation
from advercity.dataset.documents import plain
from advercity.dataset.reading import Reading
from advercity.dataset.sightings import Sighting


def extras(reading: Reading, objects: Sequence[Annotation]) -> dict[str, Any]:
    """Document of one viewpoint and what it annotates, in plain types; by id as in its YAML.

    `lidar_points` are those that came back through the weather, `lidar_hits` those that would have
    in none. `roles` are an object's parts in staged conflicts, by their ids. `cameras` has those
    whose pictures its outline reaches into.
    """
    numbers, counts = np.unique(reading.cloud.instance, return_counts=True)
    points = dict(zip(numbers.tolist(), counts.tolist(), strict=True))
    return {
        "frame": reading.frame.index,
        "time_s": plain(reading.frame.time_s),
        "objects": {
            str(item.state.actor.id): _object(item, reading, points.get(item.state.actor.id, 0))
            for item in objects
        },
    }


def _object(item: Annotation, reading: Reading, lidar_points: int) -> dict[str, Any]:
    state = item.state
    x, y, z = (state.world_from_body[:3, 0] * state.speed_m_s).tolist()
    return {
        "class": state.actor.actor_class,
        "roles": dict(reading.roles.get(state.actor.id, {})),
        "velocity_m_s": plain((x, -y, z), decimals=6),
        "acceleration_m_s2": plain(state.acceleration_m_s2, decimals=6),
        "lidar_hits": item.lidar_hits,
        "lidar_points": lidar_points,
        "cameras": {
            f"camera{index}": _sighting(picture.sightings[state.actor.id])
            for index, picture in enumerate(reading.pictures)
            if state.actor.id in picture.sightings
        },
    }


def _sighting(sighting: Sighting) -> dict[str, Any]:
    box = sighting.visible_box
    return {
        "visible_px": sighting.visible_px,
        "visible_fraction": plain(sighting.visible_fraction, decimals=4),
        "occlusion": plain(sighting.occlusion, decimals=4),
        "truncation": plain(sighting.truncation, decimals=4),
        "visible_box": None if box is None else plain(box, decimals=2),
        "outline_box": plain(sighting.outline_box, decimals=2),
    }
