"""Roads of millimetres, which editors leave between others."""

from dataclasses import replace

from advercity.roads.opendrive.document import Connection, Junction, OpenDriveMap, RoadLink

MIN_ROAD_M = 0.01
"""Shorter roads have no direction."""


def bridge_short_roads(document: OpenDriveMap) -> OpenDriveMap:
    """Remove short roads, and link the roads before and behind them."""
    short = {name: road for name, road in document.roads.items() if road.length_m < MIN_ROAD_M}
    if not short:
        return document

    def follow(link: RoadLink | None) -> RoadLink | None:
        left = set(short)
        while link is not None and link.element_type == "road" and link.id in left:
            left.remove(link.id)
            link = short[link.id].get_link("end" if link.contact == "start" else "start")
        return link

    def enter(connection: Connection, junction: str) -> Connection:
        road = short.get(connection.incoming_road)
        links = () if road is None else (road.predecessor, road.successor)
        beyond = (follow(link) for link in links if link is not None and link.id != junction)
        incoming = next((link.id for link in beyond if link is not None), connection.incoming_road)
        return replace(connection, incoming_road=incoming)

    roads = {
        name: replace(road, predecessor=follow(road.predecessor), successor=follow(road.successor))
        for name, road in document.roads.items()
        if name not in short
    }
    junctions = {
        name: Junction(name, tuple(enter(item, name) for item in junction.connections))
        for name, junction in document.junctions.items()
    }
    return replace(document, roads=roads, junctions=junctions)
