"""Decks of bridges: paving over other paving, with the parts beside and below it.

A deck spans the lower street with its sidewalks and a margin. It is a slab with an underside,
parapets along its edges, and an abutment at either end; between the abutments the ground belongs to
the lower street. Beyond them the upper street lies on the ground, which is filled up to it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from advercity.geometry.extrusion import Heights, extrude_area
from advercity.geometry.mesh import GRID_M, Mesh, TriangleSurface, join_surfaces
from advercity.geometry.polyline import Points
from advercity.roads.imported_surface import HeightInterpolator
from advercity.roads.lane_segments import LaneSegment
from advercity.roads.overpasses import LaneBands, Overpasses, find_overpasses
from advercity.scene.terrain import Cutting
from advercity.semantics import Semantic

MARGIN_M = 2.5
"""Distance from the lower street's paving to the abutments."""
NEAR_M = 15.0
"""Greatest distance of a deck's end from the crossing of lanes."""
SLAB_M, SLAB_PER_RISE = 0.9, 0.25
"""Thickness of a slab, and its largest part of the height over the lower street."""
PARAPET_WIDTH_M, PARAPET_HEIGHT_M = 0.3, 1.1
ABUTMENT_M, FOOTING_M = 0.6, 0.5
"""Thickness of an abutment, and its depth in the ground."""
TOP_GAP_M = 0.03
"""Distance of the slab's top below the paving, which would flicker otherwise."""
FACET_M = 2.0
JOINED_M = 1.0
"""Distance of crossings of lanes on one deck."""


@dataclass(frozen=True, eq=False)
class Deck:
    """A structure carrying lanes over others.

    Attributes:
        carried: Plan of its paving.
        opening: Plan of the free space below it, and beside it.
        under: Plan of the lower paving near it.
        heights: Height of the upper lanes.
        slab_m: Thickness of the slab.
    """

    carried: BaseGeometry
    opening: BaseGeometry
    under: BaseGeometry
    heights: HeightInterpolator
    slab_m: float

    @property
    def plan(self) -> BaseGeometry:
        """Plan of the slab and its parapets."""
        wide = shapely.buffer(self.carried, PARAPET_WIDTH_M, join_style="mitre")
        return shapely.intersection(wide, self.opening, grid_size=GRID_M)

    @property
    def rim(self) -> BaseGeometry:
        """Plan of the deck and its abutments."""
        wide = (
            shapely.buffer(area, ABUTMENT_M, join_style="mitre")
            for area in (self.plan, self.opening)
        )
        return shapely.intersection(*wide, grid_size=GRID_M)

    def shift(self, by_m: float) -> Heights:
        """Return the heights shifted up from the upper lanes."""
        return lambda points: self.heights.height_at(points) + by_m

    def build(self, ground: Heights) -> Iterator[TriangleSurface]:
        """Build slab, parapets and abutments, which stand on the ground of the lower street."""
        below, top = self.shift(-self.slab_m), self.shift(-TOP_GAP_M)
        yield from extrude_area(self.carried, below, top, FACET_M)
        parapets = shapely.difference(self.plan, self.carried, grid_size=GRID_M)
        yield from extrude_area(parapets, below, self.shift(PARAPET_HEIGHT_M), FACET_M)
        ends = shapely.difference(self.rim, self.opening, grid_size=GRID_M)
        foot = float(ground(shapely.get_coordinates(self.under)).min()) - FOOTING_M
        yield from extrude_area(ends, lambda points: np.full(len(points), foot), top, FACET_M)


def find_decks(lanes: Sequence[LaneSegment]) -> tuple[Deck, ...]:
    """Find the decks of all lanes over others."""
    bands = LaneBands.from_borders([(lane.left, lane.right) for lane in lanes])
    found = find_overpasses(bands)
    labels = _join_crossings(found)
    return tuple(_build_deck(bands, found, labels == label) for label in np.unique(labels))


def build_deck_meshes(decks: Sequence[Deck], ground: Heights) -> list[Mesh]:
    """Build the mesh of all decks; empty without decks."""
    pieces = [piece for deck in decks for piece in deck.build(ground)]
    if not pieces:
        return []
    return [join_surfaces(pieces).to_mesh("decks", "concrete", Semantic.BRIDGE)]


def find_cuttings(decks: Sequence[Deck]) -> tuple[Cutting, ...]:
    """Find the ground under decks."""
    return tuple(
        Cutting(shapely.intersection(deck.rim, deck.opening), deck.opening, deck.rim)
        for deck in decks
    )


def cut_ground_edges(edges: Sequence[Points], decks: Sequence[Deck]) -> list[Points]:
    """Remove edges (n, 3) on decks from the paved edges for levelling the ground."""
    for deck in decks:
        edges = [part for edge in edges for part in _cut_edge(edge, deck)]
    return list(edges)


def find_paved_ground(paved_area: BaseGeometry, decks: Sequence[Deck]) -> BaseGeometry:
    """Find the area in which paving lies on the ground, rather than on a deck alone."""
    for deck in decks:
        free = shapely.difference(deck.plan, deck.under, grid_size=GRID_M)
        paved_area = shapely.difference(paved_area, free, grid_size=GRID_M)
    return paved_area


def _join_crossings(found: Overpasses) -> NDArray[np.intp]:
    """Label crossings (k,) of lanes; touching ones at one level have the same label."""
    labels = np.arange(len(found.areas))
    if not len(labels):
        return labels
    one, other = shapely.STRtree(found.areas).query(
        found.areas, predicate="dwithin", distance=JOINED_M
    )
    level = np.abs(found.height_m[one] - found.height_m[other]) < JOINED_M
    one, other = one[level], other[level]
    while True:
        least = labels.copy()
        np.minimum.at(least, one, labels[other])
        if (least == labels).all():
            return labels
        labels = least


def _build_deck(bands: LaneBands, found: Overpasses, is_own: NDArray[np.bool_]) -> Deck:
    near = shapely.buffer(shapely.union_all(found.areas[is_own]), NEAR_M)
    over, under = np.unique(found.over[is_own]), np.unique(found.under[is_own])
    lower = shapely.intersection(shapely.union_all(bands.areas[under]), near, grid_size=GRID_M)
    opening = shapely.buffer(lower, MARGIN_M, join_style="mitre")
    upper = shapely.union_all(bands.areas[over], grid_size=GRID_M)
    return Deck(
        carried=shapely.intersection(upper, opening, grid_size=GRID_M),
        opening=opening,
        under=lower,
        heights=HeightInterpolator(bands.lines[over]),
        slab_m=min(SLAB_M, SLAB_PER_RISE * float(found.rise_m[is_own].min())),
    )


def _cut_edge(edge: Points, deck: Deck) -> list[Points]:
    line = shapely.LineString(edge)
    if not shapely.intersects(line, deck.plan):
        return [edge]
    middle = (edge[:-1] + edge[1:]) / 2
    inside = shapely.contains_xy(deck.opening, middle[:, 0], middle[:, 1])
    carried = inside & (np.abs(deck.heights.height_at(middle[:, :2]) - middle[:, 2]) < JOINED_M)
    kept = np.flatnonzero(np.diff(np.concatenate([[True], carried, [True]]).astype(np.int8)))
    return [edge[first : last + 1] for first, last in kept.reshape(-1, 2)]
