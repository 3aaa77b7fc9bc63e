"""Builds a road, however it is declared."""

from advercity_dsl import MapFile, Road

from advercity.errors import InputError
from advercity.world.authored import AuthoredRoad
from advercity.world.built_road import BuiltRoad
from advercity.world.imported import ImportedRoad
from advercity.world.layout import layout


def built(road: Road) -> BuiltRoad:
    """A road as its streets or its map say; InputError where they do not fit together."""
    match road.imported:
        case None:
            return AuthoredRoad(layout(road))
        case MapFile() as file:
            raise InputError(f"road '{road.id}': the map '{file.file}' has not been compiled")
        case network:
            return ImportedRoad(network)
