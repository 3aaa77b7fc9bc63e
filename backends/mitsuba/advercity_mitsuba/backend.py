"""The backend, found by name in the core: capabilities of this machine, and open renderers."""

from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from advercity.physics.atmosphere import Atmosphere
from advercity.rendering.backend import Capabilities, RenderProfile
from advercity.world import World
from advercity_mitsuba.devices import find_device

if TYPE_CHECKING:
    from advercity_mitsuba.renderer import MitsubaRenderer


class MitsubaBackend:
    """Paths traced by Mitsuba's kernels on a CUDA device, or compiled for the processor."""

    name = "mitsuba"

    def capabilities(self) -> Capabilities:
        """Report Mitsuba's capabilities on this machine; BackendError without LLVM and CUDA."""
        device = find_device()
        return Capabilities(
            participating_medium=True,
            lamps=True,
            wet_surfaces=True,
            deterministic=not device.is_hardware,
            ray_traced=True,
            hardware=device.is_hardware,
            device=device.name,
        )

    @contextmanager
    def open(
        self, world: World, atmosphere: Atmosphere, profile: RenderProfile
    ) -> Generator["MitsubaRenderer", None, None]:
        """Load a world; profiles for rasters are path-traced, too, with few samples."""
        find_device()
        # Mitsuba takes a second to import, so only a renderer imports it.
        from advercity_mitsuba.renderer import MitsubaRenderer

        yield MitsubaRenderer(world, atmosphere, profile)
