"""Mirrors the world of the plan frame to a left-hand road."""

from dataclasses import replace

from advercity.geometry.mesh import Mesh
from advercity.geometry.mirroring import mirror_mesh, mirror_point
from advercity.materials import MATERIALS, Texture
from advercity.roads.mirrored_network import mirror_lane
from advercity.scene.rooms import mirror_panes
from advercity.world import World


def mirror_world(world: World) -> World:
    """Mirror a world without bodies at the x axis; writing stays readable, the network as it is."""
    return replace(
        world,
        is_left_hand=True,
        static=tuple(_mirror_static(mesh) for mesh in world.static),
        lanes=tuple(mirror_lane(lane) for lane in world.lanes),
        street_lamps=tuple(
            replace(lamp, position=mirror_point(lamp.position)) for lamp in world.street_lamps
        ),
        signal_lamps=tuple(
            replace(lamp, position=mirror_point(lamp.position), facing=mirror_point(lamp.facing))
            for lamp in world.signal_lamps
        ),
    )


def _mirror_static(mesh: Mesh) -> Mesh:
    mirrored = mirror_mesh(mesh)
    if mesh.uv is None or MATERIALS[mesh.material].texture not in (Texture.ROOM, Texture.SHOP):
        return mirrored
    return replace(mirrored, uv=mirror_panes(mesh.uv))
