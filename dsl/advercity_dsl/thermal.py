"""Declaration of thermal cameras, which see the heat of surfaces, 8 to 14 um."""

from typing import Annotated

from pydantic import Field

from advercity_dsl.base import Items
from advercity_dsl.mount import Mount
from advercity_dsl.sampling import Sampled
from advercity_dsl.units import Count, Degrees, Millikelvins, Number

RAYS_PER_PIXEL = 6


class ThermalCamera(Sampled):
    """An uncooled thermal camera, 8 to 14 um; defaults describe a common car camera."""

    width_px: Annotated[Count, Field(ge=16, le=2048)] = 640
    """Image width."""
    height_px: Annotated[Count, Field(ge=16, le=2048)] = 512
    """Image height."""
    horizontal_fov_deg: Annotated[Degrees, Field(gt=2, lt=150)] = 50
    """Horizontal angle of view; the camera is a pinhole."""
    netd_mk: Annotated[Millikelvins, Field(ge=0, le=1000)] = 50
    """Noise of a pixel from image to image, as a difference of temperature at 300 K."""
    fixed_pattern_mk: Annotated[Millikelvins, Field(ge=0, le=1000)] = 25
    """Standard deviation of the constant error of a pixel, and equally of a column."""
    blur_px: Annotated[Number, Field(ge=0, le=5)] = 0.6
    """Standard deviation of a point's image: diffraction and the size of a pixel."""
    mounts: Annotated[Items[Mount], Field(min_length=1, max_length=8)]
    """Pose of each camera."""

    def count_rays(self, scale: float) -> int:
        """Count the rays of one image: a pixel has one of its own, and some to sun and sky."""
        return round(self.width_px * self.height_px * RAYS_PER_PIXEL * scale**2)
