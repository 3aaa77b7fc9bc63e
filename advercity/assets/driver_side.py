"""The side of a vehicle on which its driver sits."""

from dataclasses import replace

from advercity.assets.cabins import LINING
from advercity.geometry.mesh import Mesh, MeshLayer
from advercity.geometry.mirroring import mirror_mesh
from advercity.world import Body


def seat_driver_on_right(body: Body) -> Body:
    """Mirror the inside of a vehicle, whose driver sits on the left, in the body frame.

    Other details, which are the same on both sides, are mirrored too. A body without our
    lining, such as a model with its own seats, stays unchanged.
    """
    if not any(part.material == LINING and part.layer is MeshLayer.DETAIL for part in body.parts):
        return body
    return replace(body, parts=tuple(_mirror_inside(part) for part in body.parts))


def _mirror_inside(part: Mesh) -> Mesh:
    is_outside = part.layer is MeshLayer.SHAPE or part.wheel is not None or part.uv is not None
    return part if is_outside else mirror_mesh(part)
