"""What actors look like: plain bodies made to the size of their blueprint."""

from advercity.world.bodies.catalogue import body
from advercity.world.bodies.paint import CONNECTED_PAINT, paint_for
from advercity.world.bodies.puppets import posed

__all__ = ["CONNECTED_PAINT", "body", "paint_for", "posed"]
