"""The backend, found by name: capabilities of this machine, and open renderers.

The Vulkan device is probed in a child process: without a usable driver SAPIEN may abort it.
"""

import os
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
from advercity.processes import describe_end
from advercity.rendering.backend import Capabilities, RenderProfile
from advercity.world import World

if TYPE_CHECKING:
    import sapien

    from advercity_sapien.renderer import SapienRenderer

PROBE_SCRIPT = "import sapien; print(sapien.render.get_device_summary())"
PROBE_TIMEOUT_S = 120
DEVICE_PATTERN = re.compile(
    r"GPU: (?P<name>.+)\n\s*Supported: (?P<supported>\d+)\n.*\n"
    r"\s*cudaId:\s*(?P<cuda>-?\d+)\n\s*rayTrace:\s*(?P<ray_trace>\d+)"
)
DRIVER_SETTINGS = ("GALLIVM_DEBUG", "GALLIVM_PERF", "LP_DEBUG", "LP_PERF")
"""Variables of the driver's developers, trading precision for speed."""
INSTALL_HINT = (
    "run `make setup`, or install mesa-vulkan-drivers 25 or newer (Debian 12: from "
    "bookworm-backports), which renders on the CPU with ray tracing"
)


@dataclass(frozen=True)
class VulkanDevice:
    """A Vulkan device for rendering with SAPIEN."""

    name: str
    is_cuda: bool
    supports_ray_tracing: bool

    @property
    def is_software(self) -> bool:
        """Whether it is Mesa's CPU driver, which renders the same bytes every time."""
        return "llvmpipe" in self.name

    @property
    def sapien_name(self) -> str:
        """SAPIEN's name of it."""
        return "cuda" if self.is_cuda else "cpu"


@cache
def find_vulkan_device() -> VulkanDevice:
    """Find the best device; a GPU before the CPU. BackendError with a remedy if none exists."""
    try:
        child = subprocess.run(  # noqa: S603
            [sys.executable, "-c", PROBE_SCRIPT],
            capture_output=True,
            text=True,
            timeout=PROBE_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise BackendError(
            f"Vulkan did not respond within {PROBE_TIMEOUT_S} s; {INSTALL_HINT}"
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
        output = (child.stderr.strip() or child.stdout.strip()).splitlines()
        ended = [describe_end(child.returncode)] if child.returncode < 0 or not output else []
        reason = "; ".join([*output[-1:], *ended])
        raise BackendError(f"SAPIEN found no Vulkan device ({reason}); {INSTALL_HINT}")
    return max(devices, key=lambda device: (device.is_cuda, device.supports_ray_tracing))


class SapienBackend:
    """SAPIEN on a GPU, or on the CPU through Mesa's software driver."""

    name = "sapien"

    def capabilities(self) -> Capabilities:
        """Report SAPIEN's features on this machine; BackendError if no Vulkan device exists."""
        _drop_driver_settings()
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
        """Load a world; BackendError if this machine cannot render with `profile`."""
        _drop_driver_settings()
        device = find_vulkan_device()
        if profile.renderer == "ray_traced" and not device.supports_ray_tracing:
            raise BackendError(
                f"profile '{profile.name}' requires ray tracing, which {device.name} does not"
                f" support; choose a raster profile, or {INSTALL_HINT}"
            )
        # SAPIEN takes seconds to import and looks for a driver, so only a renderer imports it.
        import sapien

        from advercity_sapien.renderer import SapienRenderer

        sapien_device = sapien.Device(device.sapien_name)
        _keep_compiled_shaders(sapien_device, profile)
        renderer = SapienRenderer(world, atmosphere, profile, sapien_device)
        try:
            yield renderer
        finally:
            renderer.close()


def _drop_driver_settings() -> None:
    """Drop settings of Mesa's software driver: they change images without a trace in manifests.

    Shaders may stay without optimisation: their images are the same to the bit.
    """
    dropped = {name: os.environ.pop(name, "") for name in DRIVER_SETTINGS}
    if "nopt" in dropped["GALLIVM_PERF"].split(","):
        os.environ["GALLIVM_PERF"] = "nopt"


_kept: list["sapien.render.RenderSystem"] = []


def _keep_compiled_shaders(device: "sapien.Device", profile: RenderProfile) -> None:
    """Keep SAPIEN's engine for the renderers to come if it keeps their shaders, too.

    The engine ends with the last object using it. It keeps shaders of raster packs, but
    compiles ray-traced packs for every scene. Mesa's cache on disk saves most of this work, but
    identifies shaders by their number within the engine: a new engine counts anew.
    """
    import sapien

    _kept[:] = [] if profile.renderer == "ray_traced" else [sapien.render.RenderSystem(device)]
