"""Lamps and the angular distribution of their light.

`BEAMS` and `LENS` are the only descriptions of these distributions: NumPy evaluates them here, and
renderers take their shaders' constants from the same fields. Intensities are relative to the peak
of a lamp.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from advercity.geometry.arrays import FloatArray
from advercity.physics.photometry import Colour


class LampPattern(IntEnum):
    """Distribution of a lamp's light; shaders use the same numbers."""

    STREET = 0
    LOW_BEAM = 1
    LENS = 2
    FOG_BEAM = 3
    HIGH_BEAM = 4
    LED_LOW_BEAM = 5
    LEFT_HAND_LOW_BEAM = 6
    LEFT_HAND_LED_LOW_BEAM = 7


@dataclass(frozen=True)
class LightSource:
    """One lamp lighting the scene."""

    pattern: LampPattern
    position: tuple[float, ...]
    facing: tuple[float, ...]
    """Unit vector along the axis of its light."""
    intensity_cd: float
    """At the peak."""
    colour: Colour
    unobstructed_m: float = np.inf
    """Length of the free path along its axis up to another vehicle; air beyond does not glow.
    Surfaces have shadows."""


@dataclass(frozen=True)
class LampBeam:
    """Relative intensity of a headlamp with a cut-off.

    With h and v the angles in degrees to the right of the axis and above it, the cut-off lies at
    `v = clip(kink_slope h, 0, kink_max_deg) - cutoff_drop_deg`, x is the angle above it, and

        intensity = (stray + (1 - stray) / (1 + exp(x / cutoff_softness_deg)))
            * exp(-((x + peak_below_cutoff_deg) / below_width_deg)²)   where x < 0
            * exp(-(v / above_width_deg)²)                             where v > 0
            * exp(-((h - peak_right_deg) / horizontal_sigma_deg)² / 2)

    Attributes:
        cutoff_drop_deg: Angle of the level part of the cut-off below the axis.
        kink_slope: Rise of the cut-off to the right, degrees per degree; 0 if level, negative if
            it rises to the left.
        kink_max_deg: Height at which the rising part ends.
        cutoff_softness_deg: Width of the transition from light to dark.
        stray_fraction: Relative intensity above the cut-off.
        peak_below_cutoff_deg: Angle from the cut-off down to the peak.
        below_width_deg: Width of the decline below the peak, to 1/e.
        above_width_deg: Width of the decline of the stray light above the axis, to 1/e.
        peak_right_deg: Angle of the peak to the right of the axis.
        horizontal_sigma_deg: Standard deviation of the horizontal spread.
    """

    cutoff_drop_deg: float
    kink_slope: float
    kink_max_deg: float
    cutoff_softness_deg: float
    stray_fraction: float
    peak_below_cutoff_deg: float
    below_width_deg: float
    above_width_deg: float
    peak_right_deg: float
    horizontal_sigma_deg: float

    def relative_intensity(self, facing: FloatArray, rays: FloatArray) -> FloatArray:
        """Compute the intensity relative to the peak along rays (..., n, 3) of beams (..., 3)."""
        h, v = _angles_off_axis_deg(facing, rays)
        above = v + self.cutoff_drop_deg - np.clip(self.kink_slope * h, 0.0, self.kink_max_deg)
        # Bounded: exp overflows for float32 rays far above the cut-off.
        dark = np.exp(np.minimum(above / self.cutoff_softness_deg, 80.0))
        light = self.stray_fraction + (1.0 - self.stray_fraction) / (1.0 + dark)
        below_peak = (above + self.peak_below_cutoff_deg) / self.below_width_deg
        light *= np.where(above < 0.0, np.exp(-(below_peak**2)), 1.0)
        light *= np.where(v > 0.0, np.exp(-((v / self.above_width_deg) ** 2)), 1.0)
        sideways = (h - self.peak_right_deg) / self.horizontal_sigma_deg
        return np.where(np.abs(h) < 90.0, light * np.exp(-(sideways**2) / 2.0), 0.0)

    def mirror(self) -> "LampBeam":
        """Return the beam with left and right swapped, for traffic on the other side."""
        return replace(self, kink_slope=-self.kink_slope, peak_right_deg=-self.peak_right_deg)

    @property
    def equivalent_height_deg(self) -> float:
        """Height below the cut-off of an even beam as bright as the peak, with the same light."""
        peak = self.peak_below_cutoff_deg / self.below_width_deg
        return self.below_width_deg * math.sqrt(math.pi) / 2.0 * (1.0 + math.erf(peak))

    @property
    def even_top_deg(self) -> float:
        """Top of the even beam above the cut-off, at most 0: its middle is near the peak."""
        return min(0.0, self.equivalent_height_deg / 2.0 - self.peak_below_cutoff_deg)

    def scattered_intensity(
        self, facing: FloatArray, rays: FloatArray, spread_deg: FloatArray
    ) -> FloatArray:
        """Compute `relative_intensity` after droplets have deflected all light a little.

        The cut-off dissolves over the spread (...) of `PhaseLobes.forward_spread_rad`. The beam is
        so wide that only its height matters: an even beam of `equivalent_height_deg` replaces it.
        """
        h, v = _angles_off_axis_deg(facing, rays)
        above = v + self.cutoff_drop_deg - np.clip(self.kink_slope * h, 0.0, self.kink_max_deg)
        even = above - self.even_top_deg
        light = _fraction_beyond(even / spread_deg)
        light -= _fraction_beyond((even + self.equivalent_height_deg) / spread_deg)
        stray = np.exp(-((np.maximum(v, 0.0) / self.above_width_deg) ** 2))
        light += self.stray_fraction * stray * _fraction_beyond(-above / spread_deg)
        sideways = (h - self.peak_right_deg) / self.horizontal_sigma_deg
        return np.where(np.abs(h) < 90.0, light * np.exp(-(sideways**2) / 2.0), 0.0)


LOW_BEAM = LampBeam(
    cutoff_drop_deg=0.57,
    kink_slope=0.27,
    kink_max_deg=2.07,
    cutoff_softness_deg=0.12,
    stray_fraction=0.018,
    peak_below_cutoff_deg=1.8,
    below_width_deg=2.8,
    above_width_deg=15.0,
    peak_right_deg=1.0,
    horizontal_sigma_deg=12.0,
)
"""Low beam, within the limits of UN R112, class B, at a peak of 20 kcd.

The cut-off rises by 15 degrees (tan 15° = 0.27) to the right, for traffic on the right.
"""
LED_LOW_BEAM = LampBeam(
    cutoff_drop_deg=0.57,
    kink_slope=0.27,
    kink_max_deg=2.07,
    cutoff_softness_deg=0.09,
    stray_fraction=0.016,
    peak_below_cutoff_deg=1.8,
    below_width_deg=2.3,
    above_width_deg=15.0,
    peak_right_deg=4.0,
    horizontal_sigma_deg=14.0,
)
"""Low beam of LEDs, within the limits of UN R149, class C, at a peak of 23 kcd.

Wider than a halogen lamp's, brighter to the right, its cut-off almost as sharp as allowed.
"""
FRONT_FOG_BEAM = LampBeam(
    cutoff_drop_deg=0.0,
    kink_slope=0.0,
    kink_max_deg=0.0,
    cutoff_softness_deg=0.2,
    stray_fraction=0.018,
    peak_below_cutoff_deg=1.0,
    below_width_deg=3.5,
    above_width_deg=15.0,
    peak_right_deg=0.0,
    horizontal_sigma_deg=20.0,
)
"""Front fog lamp: wide, with a level cut-off at its axis (UN R149, class F3)."""
HIGH_BEAM = LampBeam(
    cutoff_drop_deg=-12.0,
    kink_slope=0.0,
    kink_max_deg=0.0,
    cutoff_softness_deg=0.5,
    stray_fraction=0.0,
    peak_below_cutoff_deg=12.0,
    below_width_deg=3.5,
    above_width_deg=500.0,
    peak_right_deg=0.0,
    horizontal_sigma_deg=5.0,
)
"""High beam, within the limits of UN R112, class B, at a peak of 50 kcd.

Its cut-off is in the dark anyway.
"""
BEAMS = {
    LampPattern.LOW_BEAM: LOW_BEAM,
    LampPattern.LED_LOW_BEAM: LED_LOW_BEAM,
    LampPattern.FOG_BEAM: FRONT_FOG_BEAM,
    LampPattern.HIGH_BEAM: HIGH_BEAM,
    LampPattern.LEFT_HAND_LOW_BEAM: LOW_BEAM.mirror(),
    LampPattern.LEFT_HAND_LED_LOW_BEAM: LED_LOW_BEAM.mirror(),
}
LEFT_HAND_PATTERNS = {
    LampPattern.LOW_BEAM: LampPattern.LEFT_HAND_LOW_BEAM,
    LampPattern.LED_LOW_BEAM: LampPattern.LEFT_HAND_LED_LOW_BEAM,
}
"""Patterns for traffic on the left, by the pattern on the right; all others are the same."""


@dataclass(frozen=True)
class LensBeam:
    """Relative intensity of a lens, `(1 + (1 - cos a) / falloff)^-1.25`, shifted to 0 at 90°.

    Attributes:
        falloff: One minus the cosine of the angle over which the light declines.
    """

    falloff: float

    @property
    def at_right_angle(self) -> float:
        """Value of the unshifted distribution at 90 degrees."""
        return (1.0 + 1.0 / self.falloff) ** -1.25

    def relative_intensity(self, cosine: FloatArray) -> FloatArray:
        """Compute the intensity relative to the peak, by cosine (...) of the angle to the axis."""
        unshifted = (1.0 + (1.0 - np.maximum(cosine, 0.0)) / self.falloff) ** -1.25
        return (unshifted - self.at_right_angle) / (1.0 - self.at_right_angle)


LENS = LensBeam(falloff=1.0 - np.cos(np.radians(12.0)))
"""Rear lamps, indicators and signals: 0.5 at 10 degrees, 0.2 at 20 and 0.03 at 45.

Between UN R148 for vehicles' lamps (0.2 at 10 degrees, 0.1 at 20) and EN 12368 for wide signals.
"""


def _fraction_beyond(spreads: FloatArray) -> FloatArray:
    """Compute the fraction (...) of light deflected farther to one side than `spreads`.

    The integral of a Cauchy distribution's fraction over all scales up to the spread.
    """
    square = np.maximum(spreads**2, 1e-12)
    return 0.5 - (np.arctan(spreads) + 0.5 * spreads * np.log1p(1.0 / square)) / math.pi


def intensity_towards(lamps: Sequence[LightSource], rays: FloatArray) -> FloatArray:
    """Compute the luminous intensity (m, n) in cd of m lamps along unit rays (m, n, 3)."""
    relative = np.empty(rays.shape[:2], rays.dtype)
    patterns = np.array([lamp.pattern for lamp in lamps])
    facing = np.array([lamp.facing for lamp in lamps], rays.dtype)
    for pattern in set(patterns.tolist()):
        rows = np.flatnonzero(patterns == pattern)
        if pattern in BEAMS:
            relative[rows] = BEAMS[pattern].relative_intensity(facing[rows], rays[rows])
        else:
            cosine = np.maximum((rays[rows] @ facing[rows][..., None])[..., 0], 0.0)
            is_lens = pattern == LampPattern.LENS
            relative[rows] = LENS.relative_intensity(cosine) if is_lens else cosine
    return relative * np.array([lamp.intensity_cd for lamp in lamps], rays.dtype)[:, None]


def _angles_off_axis_deg(facing: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute the angles (..., n) in degrees of rays to the right of a beam's axis and above it."""
    right = np.stack([facing[..., 1], -facing[..., 0], np.zeros_like(facing[..., 0])], axis=-1)
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    axes = np.stack([facing, right, np.cross(right, facing)], axis=-1)
    forward, sideways, up = np.moveaxis(rays @ axes, -1, 0)
    return np.degrees(np.arctan2(sideways, forward)), np.degrees(np.arcsin(np.clip(up, -1.0, 1.0)))
