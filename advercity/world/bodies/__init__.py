"""What actors look like: plain bodies made to the size of their blueprint."""

from advercity.world.bodies.catalogue import body
from advercity.world.bodies.paint import paint_for

__all__ = ["body", "paint_for"]
