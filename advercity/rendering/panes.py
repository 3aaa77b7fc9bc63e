"""Finds transparent panes of glass."""

from advercity.geometry.mesh import Mesh
from advercity.materials import MATERIALS
from advercity.semantics import Semantic

PANE_MATERIALS = frozenset(name for name, item in MATERIALS.items() if item.is_transparent)


def is_seen_through(mesh: Mesh, *, is_static: bool) -> bool:
    """Whether cameras see through a mesh: panes of vehicles and of shelters.

    Panes of buildings show rooms without meshes (`scene.rooms`); the walls behind them are for
    LiDARs alone. Glass with images of its own is opaque and shows these.
    """
    is_closed = is_static and mesh.semantic is Semantic.BUILDING
    return mesh.material in PANE_MATERIALS and mesh.uv is None and not is_closed
