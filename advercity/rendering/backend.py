"""The seam between a scene and whatever renders it.

Finds rendering backends by name; plugins register under the entry point `advercity.backends`.
"""

import difflib
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from advercity.errors import BackendError, InputError
from advercity.frames import Frame
from advercity.geometry.poses import Matrix
from advercity.physics.atmosphere import Atmosphere
from advercity.world import World


@dataclass(frozen=True)
class RenderProfile:
    """How well to render, never what."""

    name: str
    scale: float
    """Of the authored width and height."""
    renderer: Literal["raster", "ray_traced"]
    samples: int = 1
    path_depth: int = 1
    denoise: bool = False

    def with_scale(self, scale: float | None) -> "RenderProfile":
        """The same quality at another image scale."""
        return self if scale is None else replace(self, scale=scale)


RENDER_PROFILES = {
    "preview": RenderProfile("preview", 0.25, "raster"),
    "full": RenderProfile("full", 1.0, "ray_traced", samples=16, path_depth=4, denoise=True),
}


@dataclass(frozen=True)
class Capabilities:
    """What a backend does natively."""

    participating_medium: bool
    """Fog attenuates and glows along every path; if False it is added from depth."""
    lamps: bool
    wet_surfaces: bool
    deterministic: bool
    """Same input, same bytes on this device."""
    ray_traced: bool
    hardware: bool
    """A graphics card rather than a software driver."""
    device: str
    """The device in words, part of a dataset's device class."""


@dataclass(frozen=True)
class CameraView:
    """One picture to take."""

    world_from_camera: Matrix
    """(4, 4), body axes: x along the view, y left, z up."""
    width_px: int
    height_px: int
    horizontal_fov_rad: float
    hide: frozenset[int] = frozenset()
    """Ids of actors that this camera must not see: its own carrier."""


@dataclass(frozen=True)
class CameraCapture:
    """What a camera's pixels met, before any optics or electronics.

    Attributes:
        radiance: (h, w, 3) float32, linear sRGB, luminance in cd/m².
        depth: (h, w) float32, metres along the optical axis; inf where there is only sky.
        normal: (h, w, 3) float32, unit, world frame; zero for sky.
        semantic: (h, w) uint8 of `Semantic`.
        instance: (h, w) int32 actor id; 0 for everything static.
    """

    radiance: NDArray[np.float32]
    depth: NDArray[np.float32]
    normal: NDArray[np.float32]
    semantic: NDArray[np.uint8]
    instance: NDArray[np.int32]


class Renderer(Protocol):
    """An open scene; frames may be placed in any order."""

    def place(self, frame: Frame) -> None:
        """Move every actor to where it is in `frame`, and switch lamps and signals."""
        ...

    def render_camera(self, view: CameraView) -> CameraCapture:
        """Take one picture of the placed frame."""
        ...

    def render_cameras(self, views: Sequence[CameraView]) -> Iterator[CameraCapture]:
        """Take pictures (at least one) of the placed frame, in order.

        The device works on the next one while the caller looks at the last, and on the first
        before it is asked for. All must be fetched before another frame is placed.
        """
        ...


class Backend(Protocol):
    """Starts renderers; keeps what they share, never the state of one."""

    @property
    def name(self) -> str:
        """As it is asked for on the command line."""
        ...

    def capabilities(self) -> Capabilities:
        """What this backend can do on this machine; BackendError if there is no device."""
        ...

    def open(
        self, world: World, atmosphere: Atmosphere, profile: RenderProfile
    ) -> AbstractContextManager[Renderer]:
        """Load a world under an atmosphere; closing the context frees the device's memory."""
        ...


ENTRY_POINT_GROUP = "advercity.backends"


TEST_MODULE = "advercity.testing"


def list_backend_names() -> list[str]:
    """List the names of installed backends without importing any.

    The fake backend for tests can be loaded by name, but is not suggested to users.
    """
    return sorted(
        {
            entry.name
            for entry in entry_points(group=ENTRY_POINT_GROUP)
            if entry.module != TEST_MODULE
        }
    )


def load_backend(name: str) -> Backend:
    """The backend called `name`.

    Raises:
        InputError: No backend has that name.
        BackendError: It does not import, or two distributions claim the name.
    """
    found = [entry for entry in entry_points(group=ENTRY_POINT_GROUP) if entry.name == name]
    if not found:
        raise InputError(_format_unknown_backend(name))
    if len({entry.value for entry in found}) > 1:
        claims = ", ".join(sorted(entry.value for entry in found))
        raise BackendError(f"backend '{name}' is claimed by {claims}; uninstall all but one")
    return _instantiate_backend(found[0])


def _instantiate_backend(entry: EntryPoint) -> Backend:
    try:
        return entry.load()()
    except ImportError as error:
        message = f"backend '{entry.name}' ({entry.value}) does not import: {error}"
        raise BackendError(message) from error


def _format_unknown_backend(name: str) -> str:
    installed = list_backend_names()
    close = difflib.get_close_matches(name, installed, n=1)
    if close:
        return f"no backend '{name}'; did you mean '{close[0]}'?"
    if not installed:
        return f"no backend '{name}'; none is installed; try: pip install advercity-sapien"
    return f"no backend '{name}'; installed: {', '.join(installed)}"
