"""Radars: settings of a sensor of range, radial velocity and direction."""

from typing import Annotated, Literal

from pydantic import Field

from advercity_dsl.base import Items
from advercity_dsl.mount import Mount
from advercity_dsl.sampling import Sampled
from advercity_dsl.units import (
    Count,
    DecibelMilliwatts,
    Decibels,
    Degrees,
    Fraction,
    Megahertz,
    MetresPerSecond,
    PositiveMetres,
)


class Radar(Sampled):
    """A 4-D imaging radar at 77 GHz: range, radial velocity, azimuth and elevation.

    Cells are its resolution. Without a rate it measures with every frame.
    """

    bandwidth_mhz: Annotated[Megahertz, Field(ge=50, le=4000)] = 375
    """Swept bandwidth; 375 MHz is a range cell of 0.4 m."""
    range_m: Annotated[PositiveMetres, Field(ge=5, le=500)] = 150
    """Maximum range."""
    max_speed_m_s: Annotated[MetresPerSecond, Field(ge=5, le=150)] = 30
    """Largest unambiguous radial velocity; faster targets fold into this interval."""
    speed_cell_m_s: Annotated[MetresPerSecond, Field(ge=0.02, le=5)] = 0.15
    """Cell of the radial velocity."""
    azimuth_fov_deg: Annotated[Degrees, Field(ge=1, le=170)] = 120
    """Horizontal field of view."""
    azimuth_cell_deg: Annotated[Degrees, Field(ge=0.1, le=30)] = 1.5
    """Horizontal cell."""
    elevation_fov_deg: Annotated[Degrees, Field(ge=1, le=120)] = 30
    """Vertical field of view."""
    elevation_cell_deg: Annotated[Degrees, Field(ge=0.1, le=30)] = 2
    """Vertical cell."""
    rays: Annotated[Count, Field(ge=100, le=1_000_000)] = 60_000
    """Number of rays over the field of view."""
    bounces: Annotated[Count, Field(ge=1, le=3)] = 3
    """Most surfaces hit by a ray, one after the other."""
    transmit_dbm: Annotated[DecibelMilliwatts, Field(ge=-20, le=40)] = 12
    """Transmitted power."""
    noise_figure_db: Annotated[Decibels, Field(ge=0, le=40)] = 12
    """Noise figure of the receiver."""
    detector: Literal["ca", "os"] = "ca"
    """How the noise around a cell is estimated: cell-averaging or ordered-statistic CFAR."""
    threshold_db: Annotated[Decibels, Field(ge=3, le=40)] = 13
    """Detection threshold of the power, over the estimated noise."""
    duty_cycle: Annotated[Fraction, Field(ge=0.01)] = 0.5
    """Fraction of the time in which it transmits, and so disturbs other radars."""
    output: Literal["points", "cube"] = "points"
    """Whether the powers of all cells are written too."""
    mounts: Annotated[Items[Mount], Field(min_length=1, max_length=8)]
    """Pose of each radar of this kind."""

    def count_rays(self, scale: float) -> int:
        """Count the rays of one measurement, at any scale of images."""
        return self.rays
