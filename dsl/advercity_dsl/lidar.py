"""LiDARs of rigs, and their named models in a library.

If all fields with a default of null or zero are left out (`beam`, `receiver`, `elevations_deg`,
`prisms` and others), a LiDAR is the ideal one of the original dataset.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import CompactModel, Declaration, Id, InvalidCombination, Items, is_none
from advercity_dsl.mount import Elevation, Mount
from advercity_dsl.sampling import Sampled
from advercity_dsl.units import (
    Count,
    Decibels,
    Degrees,
    Flag,
    Fraction,
    Lux,
    Metres,
    Millimetres,
    Milliradians,
    Nanoseconds,
    Number,
    PositiveMetres,
    RangeReason,
)

MAX_CHANNELS = 256
MIN_MOVING_HZ = 2.0
"""Scans per second from which poses between start and end of a scan are interpolated."""
Azimuth = Annotated[Degrees, Field(ge=-180, le=180)]
AzimuthOffset = Annotated[Degrees, Field(ge=-60, le=60)]
Efficiency = Annotated[
    Number, Field(ge=0.01, le=10), RangeReason("relative to the mean of all channels")
]
Divergence = Annotated[Milliradians, Field(ge=0.05, le=50)]
ChannelTable = Literal["uniform", "hdl_32e", "vlp_32c"]


class LidarBeam(CompactModel):
    """Shape of a beam and length of its pulse; by default from the VLP-32C's manual."""

    horizontal_mrad: Divergence = 3.0
    """Full divergence along the scan."""
    vertical_mrad: Divergence = 1.5
    """Full divergence across the scan."""
    width_mm: Annotated[Millimetres, Field(ge=0.1, le=200)] = 12
    """Width where it leaves the sensor."""
    height_mm: Annotated[Millimetres, Field(ge=0.1, le=200)] = 9
    """Height where it leaves the sensor."""
    pulse_ns: Annotated[Nanoseconds, Field(ge=0.2, le=100)] = 5
    """Full width of a pulse at half of its power. Returns within half of its length, 0.75 m for
    5 ns, overlap and count as one."""


class LidarReceiver(CompactModel):
    """Sensitivity of a receiver, as in data sheets: the detection range of a target of 10 %."""

    range_at_10_percent_m: Annotated[PositiveMetres, Field(ge=1, le=1000)] = 80
    """Detection range in clear air of a target of 10 % that faces the sensor."""
    detection_probability: Annotated[Fraction, Field(ge=0.5, le=0.999)] = 0.5
    """Probability with which it is detected there."""
    illuminance_lx: Lux = 0
    """Daylight at this range; by night the range is longer."""
    near_field_m: Annotated[Metres, Field(ge=0, le=200)] = 10
    """Range within which the receiver's gain is reduced: near returns grow no further. A longer one
    suppresses fog, rain and snow, all of which return from near."""
    noise_range_error_m: Annotated[Metres, Field(ge=0, le=10)] = 0.75
    """Standard deviation of the range of a return as strong as the noise, for
    `range_noise_model: signal`; it falls with the signal-to-noise ratio."""
    min_range_m: Annotated[Metres, Field(ge=0, le=20)] = 0
    """Range up to which returns are discarded."""
    field_of_view_mrad: Annotated[Milliradians, Field(ge=0, le=500)] = 0
    """Full angle from which a channel receives. Half of the light scattered by droplets and drops
    goes forward and stays within it in part; 0 loses all of it."""
    stray_light_db: Annotated[Decibels, Field(ge=-90, le=-20)] | None = None
    """Power that a beam 1 deg off a target receives from it, relative to a beam on it; it falls
    with the square of the angle. Surfaces brighter than white, such as signs, bloom by it."""
    white_level: Annotated[Count, Field(ge=1, le=254)] | None = None
    """Reported level, 0 to 255, of a diffuse target of 100 %; the levels above are for
    retroreflectors. `null` reports the reflectance itself, at most 1."""
    range_step_m: Annotated[Metres, Field(ge=0, le=1)] = 0
    """Step of reported ranges; 0 reports them in full."""


class PrismScan(CompactModel):
    """Two wedge prisms on one axis, which turn and deflect all beams (a Risley pair).

    A beam is off the axis by the sum of two turning vectors. The pattern goes on with every scan
    and fills a disc.
    """

    first_deg: Annotated[Degrees, Field(gt=0, le=45)]
    """Deflection by the first prism."""
    second_deg: Annotated[Degrees, Field(gt=0, le=45)]
    """Deflection by the second prism."""
    first_rpm: Annotated[Number, Field(ge=-100_000, le=100_000)]
    """Revolutions of the first prism per minute; negative turns clockwise, seen along the axis."""
    second_rpm: Annotated[Number, Field(ge=-100_000, le=100_000)]
    """Revolutions of the second prism per minute."""


class Lidar(Sampled):
    """A spinning LiDAR with a scan for every frame, each starting straight ahead and turning left.

    The defaults are the original dataset's: an ideal instrument with instant scans, but through the
    weather. With `azimuth_deg` or `prisms` it looks ahead instead of spinning.
    """

    model: Id | None = None
    """Model of the library, with the figures of all fields not given here."""

    mount: Mount = Mount()
    """Pose on the carrier."""
    channel_table: ChannelTable = "uniform"
    """Elevations of the channels: uniform from `lower_deg` to `upper_deg`, or of a real sensor."""
    elevations_deg: Annotated[Items[Elevation], Field(max_length=MAX_CHANNELS)] = ()
    """Elevation of every channel, in any order; without them, `channel_table` has them."""
    azimuth_offsets_deg: Annotated[Items[AzimuthOffset], Field(max_length=MAX_CHANNELS)] = ()
    """Azimuth of every channel relative to the head, positive to the left, in the same order."""
    channel_efficiency: Annotated[Items[Efficiency], Field(max_length=MAX_CHANNELS)] = ()
    """Power of every channel relative to the mean, in the order of `elevations_deg`; without
    those, from the lowest up. Reported intensities are calibrated, so it shows in ranges only."""
    prisms: PrismScan | None = None
    """Prisms for a scan ahead, in place of a spinning head."""
    azimuth_deg: tuple[Azimuth, Azimuth] | None = Field(default=None, exclude_if=is_none)
    """First and last azimuth, positive to the left, of a sensor with a limited view ahead, as [-60,
    60]: a scan is `azimuths` columns from the one to the other. `null` is a whole turn."""
    channels: Annotated[Count, Field(ge=1, le=MAX_CHANNELS)] = 32
    """Number of channels."""
    lower_deg: Elevation = -25
    """Elevation of the lowest beam."""
    upper_deg: Elevation = 15
    """Elevation of the highest beam."""
    azimuths: Annotated[Count, Field(ge=16, le=36_000)] = 3750
    """Beams per channel in one scan."""
    beam: LidarBeam = LidarBeam()
    """Shape of the beams."""
    receiver: LidarReceiver = LidarReceiver()
    """Sensitivity and processing of the receiver."""
    range_m: Annotated[PositiveMetres, Field(ge=1, le=1000)] = 200
    """Maximum range."""
    sub_rays: Literal[1, 7] = 1
    """Rays per beam; with 7, a beam can hit two surfaces at an edge."""
    motion_distortion: Flag = False
    """Whether everything moves during the scan, which takes one period of `rate_hz`, or of the
    frames without it; otherwise it takes an instant."""
    echoes: Literal["strongest", "last", "dual"] = "strongest"
    """Which returns of a beam are reported; dual is both."""
    detection: Literal["noisy", "step"] = "noisy"
    """Whether noise of the receiver affects detection near the threshold, or a step decides."""
    range_noise_m: Annotated[Metres, Field(ge=0, le=1)] = 0
    """Standard deviation of the range."""
    range_noise_model: Literal["fixed", "signal"] = "fixed"
    """`signal` adds noise for weak returns: 0.75 m over the signal-to-noise ratio."""
    soft_gain: Annotated[Number, Field(ge=0, le=100)] = 1
    """Gain on returns from fog, dust and spray; below 1 for receivers with suppression."""
    sunlight_noise: Flag = True
    """Whether daylight raises the threshold and the sun blinds beams towards it."""
    dropoff_rate: Fraction = 0
    """Fraction of rays dropped at random."""
    dropoff_intensity_limit: Fraction = 1
    """Intensity below which a return may be lost."""
    dropoff_zero_intensity: Fraction = 0
    """Probability of loss of a return of zero intensity; lower for stronger ones."""

    def count_rays(self, scale: float) -> int:
        """Count the rays of one scan, at any scale of images."""
        return self.channels * self.azimuths * self.sub_rays

    def find_scan_period_s(self, tick_s: float) -> float:
        """Return how long a scan takes, which is from one to the next.

        Args:
            tick_s: Time between frames, at which it scans without a rate of its own.
        """
        return tick_s if self.rate_hz is None else 1.0 / self.rate_hz

    @model_validator(mode="after")
    def _check_scan_period(self) -> Self:
        if self.motion_distortion and self.rate_hz is not None and self.rate_hz < MIN_MOVING_HZ:
            message = f"gives scans of {1 / self.rate_hz:g} s, in which motion is not even"
            hint = f"give at least {MIN_MOVING_HZ:g}, or no motion_distortion"
            raise InvalidCombination(("rate_hz",), message, hint)
        return self

    @model_validator(mode="after")
    def _check_azimuths(self) -> Self:
        if self.azimuth_deg is None:
            return self
        if self.prisms is not None:
            message, hint = "are given, and so are prisms", "give one of both"
            raise InvalidCombination(("azimuth_deg",), message, hint, other_path=("prisms",))
        first, last = self.azimuth_deg
        if not 0 < last - first < 360:
            message = f"goes from {first:g} to {last:g} deg"
            hint = "give the rightmost, then the leftmost, less than a turn apart"
            raise InvalidCombination(("azimuth_deg",), message, hint)
        return self

    @model_validator(mode="after")
    def _check_channel_count(self) -> Self:
        if self.elevations_deg:
            if self.channel_table != "uniform":
                hint = "give one of both"
                message = f"are given, and so is channel_table: {self.channel_table}"
                raise InvalidCombination(("elevations_deg",), message, hint)
        elif self.channel_table != "uniform" and self.channels != 32:
            raise ValueError(f"{self.channel_table} has 32 channels, not {self.channels}")
        if self.azimuth_offsets_deg and not self.elevations_deg:
            hint = "give elevations_deg in the same order"
            raise InvalidCombination(("azimuth_offsets_deg",), "have no elevations", hint)
        for name in ("elevations_deg", "azimuth_offsets_deg", "channel_efficiency"):
            count = len(getattr(self, name))
            if count not in (0, self.channels):
                message = f"has {count} values for {self.channels} channels"
                raise InvalidCombination((name,), message, "give one for each of `channels`")
        return self

    @model_validator(mode="after")
    def _check_elevation_range(self) -> Self:
        if self.upper_deg <= self.lower_deg:
            raise ValueError(
                f"upper_deg {self.upper_deg:g} is not above lower_deg {self.lower_deg:g}"
            )
        return self


class LidarModel(Declaration):
    """A LiDAR as one can buy it, which rigs name: `lidar: {model: ID}`."""

    kind: Literal["lidar_model"] = "lidar_model"
    wavelength_nm: Annotated[
        Number,
        Field(ge=820, le=980),
        RangeReason("reflectances and extinctions are given for 905 nm"),
    ] = 905
    """Wavelength, without effect: materials and air hardly change within its bounds."""
    lidar: Lidar
    """Its figures; a rig gives the mount, and may give other figures."""

    @model_validator(mode="after")
    def _check_model(self) -> Self:
        if self.lidar.model is not None:
            hint = "remove it; models build on others by `extends`"
            raise InvalidCombination(("lidar", "model"), "is for rigs", hint)
        return self
