"""Roads built from authored streets and junctions."""

from collections.abc import Iterator

import numpy as np
import shapely
from advercity_dsl.road import StripKind
from shapely.geometry.base import BaseGeometry

from advercity.curves import Points
from advercity.streets import Band, StreetLayout
from advercity.world import lanes
from advercity.world.built_road import Head, PostedSign
from advercity.world.layout import Layout
from advercity.world.scene import Lane, Mesh
from advercity.world.surface import KERB_HEIGHT_M, road_meshes

SNAP_M = 0.001


class AuthoredRoad:
    """A `BuiltRoad` from a layout."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout

    @property
    def lanes(self) -> tuple[Lane, ...]:
        """Lanes by street and number."""
        return lanes.lanes(self._layout)

    @property
    def meshes(self) -> list[Mesh]:
        """Roadways, kerbs, sidewalks, medians and paint."""
        return road_meshes(self._layout)

    @property
    def rims(self) -> list[Points]:
        """Edges of all paving."""
        return list(_rims(self._layout))

    @property
    def footprint(self) -> BaseGeometry:
        """What streets and junctions cover."""
        return _footprint(self._layout)

    @property
    def axes(self) -> BaseGeometry:
        """Axes of the streets."""
        streets = self._layout.streets.values()
        return shapely.MultiLineString([shapely.LineString(item.axis[:, :2]) for item in streets])

    @property
    def kerbless(self) -> BaseGeometry:
        """The roadways of junctions: SUMO's walking areas reach out onto them."""
        outlines = [junction.outline[:, :2] for junction in self._layout.junctions.values()]
        return shapely.union_all([shapely.Polygon(outline) for outline in outlines])

    @property
    def heads(self) -> tuple[Head, ...]:
        """Signal heads, as declared."""
        found: list[Head] = []
        for junction in self._layout.junctions.values():
            signals = junction.declared.signals
            for head in signals.heads if signals else ():
                x, y = junction.arm(head.street).outward
                name = f"{junction.id}/{head.street}"
                found.append(Head(name, head.at_m, head.pole_m, (float(x), float(y))))
        return tuple(found)

    @property
    def signs(self) -> tuple[PostedSign, ...]:
        """Signs, as declared."""
        found: list[PostedSign] = []
        for junction in self._layout.junctions.values():
            for sign in junction.declared.signs:
                x, y = junction.arm(sign.street).outward
                found.append(PostedSign(sign.kind, sign.at_m, (float(x), float(y))))
        return tuple(found)


def _rims(layout: Layout) -> Iterator[Points]:
    def lifted(line: Points, raised: bool) -> Points:
        return line + np.array([0.0, 0.0, KERB_HEIGHT_M * raised])

    for street in layout.streets.values():
        left, right = (street.line(t) for t in _reach(street))
        yield lifted(left[::-1], _is_raised(street.left))
        yield lifted(right, _is_raised(street.right))
        if street.begins not in layout.junctions:
            yield np.stack([left[0], right[0]])
        if street.ends not in layout.junctions:
            yield np.stack([right[-1], left[-1]])
    for junction in layout.junctions.values():
        following = (*junction.arms[1:], junction.arms[0])
        for corner, arm, other in zip(junction.corners, junction.arms, following, strict=True):
            rim = lifted(corner.rim, corner.back is not None)
            if corner.back is None:
                rim[0, 2] += KERB_HEIGHT_M * _is_raised(arm.bands(leftwards=True))
                rim[-1, 2] += KERB_HEIGHT_M * _is_raised(other.bands(leftwards=False))
            yield rim


def _is_raised(bands: tuple[Band, ...]) -> bool:
    return bool(bands) and bands[-1].kind is StripKind.SIDEWALK


def _reach(street: StreetLayout) -> tuple[float, float]:
    """Offsets of the outer edges of a street, left and right."""
    return (
        street.left[-1].outer_t if street.left else 0.0,
        street.right[-1].outer_t if street.right else 0.0,
    )


def _footprint(layout: Layout) -> BaseGeometry:
    shapes: list[shapely.Geometry] = []
    for street in layout.streets.values():
        left, right = (street.line(t)[:, :2] for t in _reach(street))
        shapes.append(shapely.make_valid(shapely.Polygon(np.vstack([left, right[::-1]]))))
    for junction in layout.junctions.values():
        rim = np.concatenate([corner.rim[:, :2] for corner in junction.corners])
        shapes.append(shapely.make_valid(shapely.Polygon(rim)))
    return shapely.union_all(shapes, grid_size=SNAP_M)
