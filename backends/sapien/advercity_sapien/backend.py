"""What the core asks for by name: capabilities of this machine, and open renderers."""

from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from advercity.errors import BackendError
from advercity.rendering.backend import Capabilities, Profile
from advercity.weather.atmosphere import Atmosphere
from advercity.world.scene import World
from advercity_sapien.device import WAY_OUT, probe

if TYPE_CHECKING:
    from advercity_sapien.renderer import SapienRenderer


class SapienBackend:
    """SAPIEN on a GPU, or on the CPU through Mesa's software driver."""

    name = "sapien"

    def capabilities(self) -> Capabilities:
        """What SAPIEN can do on this machine; BackendError if there is no Vulkan device."""
        device = probe()
        return Capabilities(
            participating_medium=True,
            lamps=True,
            wet_surfaces=True,
            deterministic=device.is_software,
            ray_traced=device.ray_traced,
            hardware=not device.is_software,
            device=device.name,
        )

    @contextmanager
    def open(
        self, world: World, atmosphere: Atmosphere, profile: Profile
    ) -> Generator["SapienRenderer", None, None]:
        """Load a world; BackendError if this machine cannot render it the way `profile` asks."""
        device = probe()
        if profile.renderer == "ray_traced" and not device.ray_traced:
            raise BackendError(
                f"profile '{profile.name}' asks for ray tracing, which {device.name} lacks; "
                f"choose a raster profile, or {WAY_OUT}"
            )
        # SAPIEN takes seconds to import and looks for a driver; only a renderer needs it.
        import sapien

        from advercity_sapien.renderer import SapienRenderer

        chosen = sapien.Device("cuda" if device.cuda else "cpu")
        renderer = SapienRenderer(world, atmosphere, profile, chosen)
        try:
            yield renderer
        finally:
            renderer.close()
