"""Roads built from the SUMO network that a map was compiled to."""

import shapely
from advercity_dsl import MapNetwork
from shapely.geometry.base import BaseGeometry

from advercity.curves import Points
from advercity.networks import unpacked
from advercity.world.built_road import Head, PostedSign
from advercity.world.imported import paint, signs
from advercity.world.imported.net import Net, NetEdge, read_net
from advercity.world.imported.surface import Surface
from advercity.world.scene import Lane, Mesh


class ImportedRoad:
    """A `BuiltRoad` from a map."""

    def __init__(self, imported: MapNetwork) -> None:
        """InputError if the network is none."""
        self._net: Net = read_net(unpacked(imported.network))
        self._surface = Surface(self._net)

    @property
    def lanes(self) -> tuple[Lane, ...]:
        """Lanes by SUMO's ids."""
        streets = [_lane(edge, at, in_junction=False) for edge, at in _each(self._net.streets)]
        inside = (*self._net.ways, *self._net.crossings)
        return (
            *streets,
            *(
                _lane(edge, at, in_junction=True)
                for edge, at in _each({edge.id: edge for edge in inside})
                if edge.lanes[at].kind in ("driving", "crossing")
            ),
        )

    @property
    def meshes(self) -> list[Mesh]:
        """Roadway, sidewalks, kerbs and paint."""
        return [*self._surface.meshes(), *paint.meshes(self._net, self._surface)]

    @property
    def rims(self) -> list[Points]:
        """Edges of all paving."""
        return self._surface.rims

    @property
    def footprint(self) -> BaseGeometry:
        """All that is paved."""
        return self._surface.footprint

    @property
    def axes(self) -> BaseGeometry:
        """Left borders of the streets."""
        return shapely.MultiLineString(
            [
                shapely.LineString(edge.driving[-1].left[:, :2])
                for edge in self._net.streets.values()
                if edge.driving
            ]
        )

    @property
    def kerbless(self) -> BaseGeometry:
        """Where people on foot are on the roadway: on all of it that is not raised."""
        surface = self._surface
        return shapely.difference(surface.roadway, shapely.buffer(surface.raised, 0.01))

    @property
    def heads(self) -> tuple[Head, ...]:
        """Signal heads."""
        return tuple(signs.heads(self._net, self._surface))

    @property
    def signs(self) -> tuple[PostedSign, ...]:
        """Signs."""
        return tuple(signs.signs(self._net, self._surface))


def _each(edges: dict[str, NetEdge]) -> list[tuple[NetEdge, int]]:
    return [(edge, at) for edge in edges.values() for at in range(len(edge.lanes))]


def _lane(edge: NetEdge, at: int, *, in_junction: bool) -> Lane:
    lane = edge.lanes[at]
    return Lane(lane.id, lane.kind, lane.left, lane.right, in_junction=in_junction)
