"""Junctions of an OpenDRIVE map with traffic lights."""

from collections.abc import Iterator

from advercity.roads.opendrive.document import Contact, OpenDriveMap, Road

MAX_LIGHT_DISTANCE_M = 60.0
"""Distance from a junction within which a light of an incoming road governs it."""

SEEN_FROM: dict[str, tuple[Contact, ...]] = {"+": ("end",), "-": ("start",)}
"""Ends of a road with a light nearby, by the direction of its traffic."""


def find_signalled_junctions(document: OpenDriveMap) -> set[str]:
    """Find junctions with lights along their connecting roads or at the end of incoming roads."""
    return {junction for road in document.roads.values() for junction in _list_governed(road)}


def _list_governed(road: Road) -> Iterator[str]:
    for light in road.lights:
        before_m = {"start": light.station_m, "end": road.length_m - light.station_m}
        if road.junction != "-1":
            yield road.junction
            continue
        for contact in SEEN_FROM.get(light.orientation, ("start", "end")):
            link = road.get_link(contact)
            if (
                link is not None
                and link.element_type == "junction"
                and before_m[contact] <= MAX_LIGHT_DISTANCE_M
            ):
                yield link.id
