"""Interface between scenes and rendering backends, and the registry of backends.

Plugins register a `Backend` under the entry point group `advercity.backends`.
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
    """Quality settings of a renderer; they never change the content of images."""

    name: str
    scale: float
    """Image size relative to the authored width and height."""
    renderer: Literal["raster", "ray_traced"]
    samples: int = 1
    path_depth: int = 1
    denoise: bool = False

    def with_scale(self, scale: float | None) -> "RenderProfile":
        """Copy the profile with another image scale; None keeps its own."""
        return self if scale is None else replace(self, scale=scale)


RENDER_PROFILES = {
    "preview": RenderProfile("preview", 0.25, "raster"),
    "full": RenderProfile("full", 1.0, "ray_traced", samples=16, path_depth=4, denoise=True),
}


@dataclass(frozen=True)
class Capabilities:
    """Native features of a backend on this machine."""

    participating_medium: bool
    """Fog attenuates and scatters along every path; if False, it is added from depth."""
    lamps: bool
    wet_surfaces: bool
    deterministic: bool
    """Whether the same input gives the same bytes on this device."""
    ray_traced: bool
    hardware: bool
    """Whether it runs on a graphics card rather than a software driver."""
    device: str
    """Device name, part of a dataset's device class."""


@dataclass(frozen=True)
class CameraView:
    """Pose and lens of one image to render."""

    world_from_camera: Matrix
    """(4, 4) pose, body axes: x along the view, y left, z up."""
    width_px: int
    height_px: int
    horizontal_fov_rad: float
    hide: frozenset[int] = frozenset()
    """Ids of actors hidden from this camera: the vehicle under it."""


@dataclass(frozen=True)
class CameraCapture:
    """Light and geometry at a camera's pixels, before any optics or electronics.

    Attributes:
        radiance: (h, w, 3) float32, linear sRGB, luminance in cd/m².
        depth: (h, w) float32, metres along the optical axis; inf for sky.
        normal: (h, w, 3) float32, unit, world frame; zero for sky.
        semantic: (h, w) uint8 of `Semantic`.
        instance: (h, w) int32 actor id; 0 for everything static.
    """

    radiance: NDArray[np.float32]
    depth: NDArray[np.float32]
    normal: NDArray[np.float32]
    semantic: NDArray[np.uint8]
    instance: NDArray[np.int32]


CAPTURE_ARRAYS = {
    "radiance": (np.float32, (3,)),
    "depth": (np.float32, ()),
    "normal": (np.float32, (3,)),
    "semantic": (np.uint8, ()),
    "instance": (np.int32, ()),
}
"""Type of each array of a capture, and its shape after height and width."""


def check_capture(capture: CameraCapture, view: CameraView, backend: str) -> None:
    """Check the shapes and types of a capture's arrays, which sensors take as they are.

    Raises:
        BackendError: The text names the backend, and each wrong array with its expected shape.
    """
    wrong: list[str] = []
    for name, (dtype, channels) in CAPTURE_ARRAYS.items():
        array, shape = getattr(capture, name), (view.height_px, view.width_px, *channels)
        if array.shape != shape or array.dtype != dtype:
            expected = f"{np.dtype(dtype)} {shape}"
            wrong.append(f"{name} is {array.dtype} {array.shape}, not {expected}")
    if wrong:
        raise BackendError(f"backend '{backend}' returned a wrong capture: {'; '.join(wrong)}")


class Renderer(Protocol):
    """An open scene; frames may be placed in any order."""

    def change_atmosphere(self, atmosphere: Atmosphere) -> None:
        """Replace the air and light of all later frames.

        It is called only under weathers changing over time. Data derived from light alone, such as
        skies and light probes, can be kept if `sky` is the same object as before.
        """
        ...

    def place(self, frame: Frame) -> None:
        """Place every actor as in `frame`, and set lamps and signals."""
        ...

    def render_camera(self, view: CameraView) -> CameraCapture:
        """Render one image of the placed frame."""
        ...

    def render_cameras(self, views: Sequence[CameraView]) -> Iterator[CameraCapture]:
        """Render images (at least one) of the placed frame, in order.

        The device may render ahead: the next image while the caller processes the last, the first
        before the iterator is advanced. All must be fetched before another frame is placed.
        """
        ...


class Backend(Protocol):
    """Opens renderers; holds their common resources, never the state of one."""

    @property
    def name(self) -> str:
        """Name of the backend on the command line."""
        ...

    def capabilities(self) -> Capabilities:
        """Report the backend's features on this machine; BackendError without a device."""
        ...

    def open(
        self, world: World, atmosphere: Atmosphere, profile: RenderProfile
    ) -> AbstractContextManager[Renderer]:
        """Load a world and its atmosphere; closing the context frees the device's memory."""
        ...


ENTRY_POINT_GROUP = "advercity.backends"
OWN_BACKENDS = ("mitsuba", "sapien")
"""Names of the backends of this project, which are extras of its distribution."""


TEST_MODULE = "advercity.testing"


def list_backend_names() -> list[str]:
    """List the names of installed backends without importing any.

    The fake backend for tests can be loaded by name, but is not suggested to users.
    """
    entries = entry_points(group=ENTRY_POINT_GROUP)
    return sorted({entry.name for entry in entries if entry.module != TEST_MODULE})


def load_backend(name: str) -> Backend:
    """Import and instantiate the backend called `name`.

    Raises:
        InputError: No backend has this name.
        BackendError: Its import fails, or two distributions claim the name.
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
    hint = f"; try: pip install advercity[{name}]" if name in OWN_BACKENDS else ""
    return f"no backend '{name}'; installed: {', '.join(installed)}{hint}"
