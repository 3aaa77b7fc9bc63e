"""Which Vulkan device there is, asked in a child process.

Without a usable Vulkan driver SAPIEN may end the process instead of raising, hence the child.

What the core asks for by name: capabilities of this machine, and open renderers.
"""

import re
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from advercity.errors import BackendError
from advercity.physics.atmosphere import Atmosphere
from advercity.rendering.backend import Capabilities, RenderProfile
from advercity.world import World

PROBE_SCRIPT = "import sapien; print(sapien.render.get_device_summary())"
DEVICE_PATTERN = re.compile(
    r"GPU: (?P<name>.+)\n\s*Supported: (?P<supported>\d+)\n.*\n"
    r"\s*cudaId:\s*(?P<cuda>-?\d+)\n\s*rayTrace:\s*(?P<ray_trace>\d+)"
)
INSTALL_HINT = (
    "run `make setup`, or install mesa-vulkan-drivers 25 or newer (Debian 12: from "
    "bookworm-backports), which renders on the CPU with ray tracing"
)


@dataclass(frozen=True)
class VulkanDevice:
    """A Vulkan device that SAPIEN can render on."""

    name: str
    is_cuda: bool
    """Whether it is a CUDA GPU, else SAPIEN's device is `cpu`."""
    supports_ray_tracing: bool

    @property
    def is_software(self) -> bool:
        """Whether it is Mesa's CPU driver, whose pictures are the same bytes every time."""
        return "llvmpipe" in self.name


@cache
def find_vulkan_device() -> VulkanDevice:
    """The best device; BackendError with the way out if there is none."""
    try:
        child = subprocess.run(  # noqa: S603
            [sys.executable, "-c", PROBE_SCRIPT],
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise BackendError(
            f"SAPIEN found no answer from Vulkan in 120 s; {INSTALL_HINT}"
        ) from error
    devices = [
        VulkanDevice(
            found["name"],
            is_cuda=int(found["cuda"]) >= 0,
            supports_ray_tracing=found["ray_trace"] == "1",
        )
        for found in DEVICE_PATTERN.finditer(child.stdout)
        if found["supported"] == "1"
    ]
    if not devices:
        said = (child.stderr.strip() or child.stdout.strip()).splitlines()
        raise BackendError(
            f"SAPIEN finds no Vulkan device{f' ({said[-1]})' if said else ''}; {INSTALL_HINT}"
        )
    return max(devices, key=lambda device: (device.is_cuda, device.supports_ray_tracing))


if TYPE_CHECKING:
    from advercity_sapien.renderer import SapienRenderer


class SapienBackend:
    """SAPIEN on a GPU, or on the CPU through Mesa's software driver."""

    name = "sapien"

    def capabilities(self) -> Capabilities:
        """What SAPIEN can do on this machine; BackendError if there is no Vulkan device."""
        device = find_vulkan_device()
        return Capabilities(
            participating_medium=True,
            lamps=True,
            wet_surfaces=True,
            deterministic=device.is_software,
            ray_traced=device.supports_ray_tracing,
            hardware=not device.is_software,
            device=device.name,
        )

    @contextmanager
    def open(
        self, world: World, atmosphere: Atmosphere, profile: RenderProfile
    ) -> Generator["SapienRenderer", None, None]:
        """Load a world; BackendError if this machine cannot render it the way `profile` asks."""
        device = find_vulkan_device()
        if profile.renderer == "ray_traced" and not device.supports_ray_tracing:
            raise BackendError(
                f"profile '{profile.name}' asks for ray tracing, which {device.name} lacks; "
                f"choose a raster profile, or {INSTALL_HINT}"
            )
        # SAPIEN takes seconds to import and looks for a driver; only a renderer needs it.
        import sapien

        from advercity_sapien.renderer import SapienRenderer

        chosen = sapien.Device("cuda" if device.is_cuda else "cpu")
        renderer = SapienRenderer(world, atmosphere, profile, chosen)
        try:
            yield renderer
        finally:
            renderer.close()
