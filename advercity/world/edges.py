"""Names of a street's edges and lanes in the SUMO network."""

from advercity_dsl.road import StripKind

from advercity.streets import Band, StreetLayout


def edge_id(street: str, *, along: bool) -> str:
    """Id of the edge along a street's axis, or against it."""
    return f"{street}{'+' if along else '-'}"


def street_of(edge: str) -> tuple[str, bool]:
    """Street of an edge, and whether the edge runs along its axis; KeyError for internal edges."""
    if edge.startswith(":") or edge[-1:] not in ("+", "-"):
        raise KeyError(edge)
    return edge[:-1], edge.endswith("+")


def approach(edge: str) -> str:
    """What an edge is called as an approach to a traffic light: its street, or as it is."""
    try:
        return street_of(edge)[0]
    except KeyError:
        return edge


def edge_bands(street: StreetLayout, *, along: bool) -> tuple[Band, ...]:
    """Bands of an edge from the innermost driving lane, or sidewalk if it has none, outwards."""
    bands = street.side(along=along)
    for kind in (StripKind.LANE, StripKind.SIDEWALK):
        for index, band in enumerate(bands):
            if band.kind is kind:
                return bands[index:]
    return ()


def lane_index(street: StreetLayout, number: int, *, along: bool) -> int:
    """Index in its edge, from the right, of a driving lane that counts from 1, the innermost."""
    bands = edge_bands(street, along=along)
    return next(index for index, band in enumerate(reversed(bands)) if band.number == number)


def lane_id(street: StreetLayout, number: int, *, along: bool) -> str:
    """SUMO's id of a driving lane that counts from 1, the innermost."""
    return f"{edge_id(street.id, along=along)}_{lane_index(street, number, along=along)}"
