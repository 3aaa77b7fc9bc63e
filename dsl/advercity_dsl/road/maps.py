"""Maps of others that a road's streets come from."""

from typing import Annotated, Literal

from pydantic import StringConstraints

from advercity_dsl.base import Digest, Model, Point2


class MapFile(Model):
    """A map that others made, from which the road's network is built when it is compiled.

    OpenDRIVE and SUMO maps keep their coordinates; an OpenStreetMap one lies around the road's
    `origin_lat_deg` and `origin_lon_deg`.
    """

    source: Literal["opendrive", "osm", "sumo"]
    """Format of the map."""
    file: Annotated[str, StringConstraints(min_length=1, max_length=1000)]
    """Its path, relative to the declaration's file."""
    sha256: Digest | None = None
    """Of the file; another map under the same name is refused."""
    extent_m: tuple[Point2, Point2] | None = None
    """Two opposite corners of a rectangle; roads wholly outside are left out."""


class MapNetwork(Model):
    """What the compiler makes of a map; a spec needs no other file."""

    source: Literal["opendrive", "osm", "sumo"]
    """Format of the map."""
    sha256: Digest
    """Of the map's file."""
    network: Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9+/]+={0,2}$")]
    """The SUMO network, as zlib in Base64."""
