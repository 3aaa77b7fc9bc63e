"""3-D models that bodies are made of: where they come from, and how they are made fit."""

from advercity.world.assets.shelf import Shelf

__all__ = ["Shelf"]
