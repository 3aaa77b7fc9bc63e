"""Cameras of a rig: image, lens, exposure, shutter and processing."""

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import (
    CompactModel,
    InvalidCombination,
    Items,
    is_empty,
    is_none,
)
from advercity_dsl.lens import MAX_RENDERED_PX, CameraLens, Intrinsics, find_edge_angle
from advercity_dsl.mount import Mount
from advercity_dsl.sampling import Sampled
from advercity_dsl.units import (
    Count,
    Degrees,
    Flag,
    Fraction,
    Milliradians,
    Milliseconds,
    Number,
    RangeReason,
    Seconds,
)


class Exposure(CompactModel):
    """Exposure of a camera."""

    mode: Literal["auto", "sensor", "manual"] = "auto"
    """`auto` meters every image with a fixed shutter: a grey filter darkens days, gain brightens
    nights. `sensor` meters without a filter: it adjusts the shutter from 20 µs to 1/30 s, or to
    `shutter_s` if longer, and then ISO up to 10,000. `manual` uses shutter and ISO as given."""
    f_number: Annotated[Number, Field(ge=0.5, le=64)] = 1.4
    """F-number of the aperture."""
    shutter_s: Annotated[Seconds, Field(ge=1e-6, le=1)] = 0.005
    """Exposure time."""
    iso: Annotated[Number, Field(ge=1, le=10_000_000)] = 100
    """Sensitivity."""
    compensation_ev: Annotated[Number, Field(ge=-8, le=8)] = 0
    """Exposure compensation in stops, positive for brighter images; 0 is the meter of ISO 2720."""


Spread = Annotated[Milliradians, Field(ge=0, le=20)]
MAX_SPREAD_PX = 30.0
"""Largest standard deviation of a point's image, which takes time by its size."""


class PointSpread(CompactModel):
    """Blur by a lens: the image of a point is a Gaussian, wider away from the middle.

    The figures are standard deviations on the sensor over the focal length: a pixel of 3 um behind
    6 mm is 0.5 mrad. The extra variance of a corner over the middle grows with the fourth power of
    the distance from the middle, as curvature of field and astigmatism of third order blur.
    """

    centre_mrad: Spread = 0
    """Standard deviation in the middle of the image."""
    corner_mrad: Spread = 0
    """Standard deviation in its corners."""

    @model_validator(mode="after")
    def _check_growth(self) -> Self:
        if self.corner_mrad < self.centre_mrad:
            message = "is less than `centre_mrad`"
            hint = "give at least `centre_mrad`; equal values blur the image evenly"
            raise InvalidCombination(("corner_mrad",), message, hint)
        return self


class Dirt(CompactModel):
    """Spots of dirt on the glass of a camera, which stay through all frames and weathers."""

    coverage: Annotated[Fraction, Field(ge=0, le=0.9)] = 0.02
    """Fraction of the glass covered by the spots."""
    seed: Count = 0
    """Seed of their places; each carrier and mount has its own for every seed."""


class RawOutput(CompactModel):
    """Values of the sensor's pixels, each behind a filter of one colour."""

    pattern: Literal["rggb", "bggr", "grbg", "gbrg"] = "rggb"
    """Filters of the first two pixels of the first row, and of the second."""
    bits: Annotated[Count, Field(ge=8, le=16)] = 12
    """Bits of the converter; its largest value is a full pixel."""
    black_level: Annotated[Count, Field(ge=0, le=4096)] = 64
    """Value without light and noise."""
    highlights_ev: Annotated[Number, Field(ge=0, le=4)] = Field(default=0, exclude_if=is_empty)
    """Stops of the largest value above a full pixel. With the stops of the camera, values merge all
    exposures, linear in light; 0 is the long exposure alone."""

    @model_validator(mode="after")
    def _check_black_level(self) -> Self:
        if self.black_level > self.full_value // 2:
            message = f"is more than half of the largest value of {self.bits} bits"
            hint = f"give at most {self.full_value // 2}, or more bits"
            raise InvalidCombination(("black_level",), message, hint)
        return self

    @property
    def full_value(self) -> int:
        """Largest value: a full pixel, or its highlights."""
        return 2**self.bits - 1


class Isp(CompactModel):
    """Image signal processor: makes the image of the values of the sensor's pixels.

    It reads the values described by `raw`. Without `raw`, it reads 16 bits with all highlights and
    a black level of 1024.
    """

    demosaic: Literal["bilinear", "edge_aware"] = "edge_aware"
    """Method to find colours between the filters: means of all neighbours, or green from the two
    neighbours between which it changes less."""
    denoise: Annotated[Fraction, Field(ge=0, le=0.95)] = 0.5
    """Fraction of the noise removed from even surfaces; 0 keeps all noise."""
    sharpening: Annotated[Fraction, Field(ge=0, le=1)] = 0.25
    """Overshoot of a sharp edge over its height."""
    jpeg_quality: Annotated[Count, Field(ge=1, le=100)] | None = Field(
        default=None, exclude_if=is_none
    )
    """Quality of the JPEG whose artefacts the image has; without it, there is no compression."""


MAX_BLURRED_S = 0.1
"""Longest blurred exposure: a tick, in which bodies move by their derivatives."""


class Shutter(CompactModel):
    """Rows exposed one after the other from the top, with motion blur.

    The frame's instant is the middle of the readout and of the exposure: then the middle row is in
    the middle of its exposure. The scene is rendered once for each band of rows, at the middle of
    the band's exposure. An object moving p pixels in the readout is at most p / (2 bands) pixels
    off. With blur, it is rendered several times over each band's exposure.
    """

    readout_ms: Annotated[Milliseconds, Field(ge=0, le=100)] = 0
    """Time from the exposure of the first row to the last row; 0 exposes all at once."""
    bands: Annotated[Count, Field(ge=1, le=128)] = 8
    """Bands of rows; each takes the time of an image."""
    blur_samples: Annotated[Count, Field(ge=1, le=33)] = 1
    """Instants of the exposure of which an image is the mean, an odd number; the middle one gives
    the labels. 1 is no blur; each takes the time of an image."""
    led_flicker: Flag = False
    """Whether signals and tail lamps flicker, as LEDs do on rectified mains and on pulses; without
    it, the sensor mitigates it."""

    @model_validator(mode="after")
    def _check_bands(self) -> Self:
        if "bands" in self.model_fields_set and self.bands > 1 and self.readout_ms == 0:
            message = "has no effect without readout_ms"
            raise InvalidCombination(("bands",), message, "give the readout time of the sensor")
        return self

    @model_validator(mode="after")
    def _check_blur_samples(self) -> Self:
        if self.blur_samples % 2 == 0:
            hint = f"give {self.blur_samples - 1} or {self.blur_samples + 1}"
            raise InvalidCombination(("blur_samples",), "is even", hint)
        return self


TruthImage = Literal["instance", "normal", "flow"]
"""An optional truth image of a camera."""


MAX_PIXEL_ASPECT = 2.0
"""Largest ratio of both focal lengths of a camera; pixels of sensors are square, or nearly so."""

MAX_PINHOLE_EDGE_RAD = math.radians(85)
"""Largest angle off the axis in a calibrated pinhole."""


class Camera(Sampled):
    """A camera; the semantic camera has the same pose, size, field of view and lens.

    Without a rate it takes an image with every frame.
    """

    width_px: Annotated[Count, Field(ge=16, le=8192)] = 1920
    """Image width."""
    height_px: Annotated[Count, Field(ge=16, le=8192)] = 1080
    """Image height."""
    horizontal_fov_deg: Annotated[
        Degrees,
        Field(gt=5, lt=170),
        RangeReason("one plane is rendered; for a wider view, mount several cameras at one place"),
    ] = 100
    """Horizontal angle of view, with the lens; the axis meets the image's middle."""
    intrinsics: Intrinsics | None = Field(default=None, exclude_if=is_none)
    """Focal lengths and principal point of a calibration, instead of `horizontal_fov_deg`."""
    calibration: Annotated[str, Field(min_length=1, max_length=1000)] | None = Field(
        default=None, exclude_if=is_none
    )
    """File with size, intrinsics and lens, relative to the declaration: ROS camera_info, or Kalibr
    chain."""
    calibrated_camera: Annotated[str, Field(min_length=1, max_length=64)] | None = Field(
        default=None, exclude_if=is_none
    )
    """Camera of a chain with several, such as `cam1`."""
    lens: CameraLens | None = Field(default=None, exclude_if=is_none)
    """Distortion by the lens; without it, the camera is a pinhole."""
    exposure: Exposure = Exposure()
    """How it is exposed."""
    highlights_ev: Annotated[Number, Field(ge=0, le=4)] = 4
    """Stops above saturation, resolved by the sensor and compressed by the tone curve; 0 clips."""
    combined_exposures: Annotated[Count, Field(ge=1, le=4)] = Field(
        default=1, exclude_if=lambda value: value == 1
    )
    """Simultaneous exposures, as of split pixels, which share these stops evenly: each value has
    the noise and the steps of the longest unsaturated exposure. 1 is a well as deep as all stops.
    """
    noise: Flag = True
    """Whether shot noise and read noise are simulated."""
    vignetting: Annotated[Number, Field(ge=0, le=8)] = 1
    """Exponent of the cosine by which images darken off axis: 4 for a simple lens, 0 for none."""
    flare: Annotated[Number, Field(ge=0, le=10)] = 1
    """Brightness of lens ghosts relative to a coated lens; 0 is none."""
    point_spread: PointSpread | None = Field(default=None, exclude_if=is_none)
    """Blur by the lens; without it, images are sharp to the pixel."""
    dirt: Dirt | None = Field(default=None, exclude_if=is_none)
    """Permanent dirt on the glass, in addition to the traces of weather; without it, none."""
    shutter: Shutter | None = Field(default=None, exclude_if=is_none)
    """Rolling shutter and blur by motion; without it, images show one instant."""
    hdr: Flag = Field(default=False, exclude_if=is_empty)
    """Whether a linear image of 16 bits is written too: the measured values before the tone curve,
    with the stops of `highlights_ev`."""
    raw: RawOutput | None = Field(default=None, exclude_if=is_none)
    """The image of the sensor's pixels behind their colour filters, which is written too; without
    it, none is."""
    isp: Isp | None = Field(default=None, exclude_if=is_none)
    """How the image is made of these pixels; without it, each pixel of the image senses all three
    colours."""
    truth: Annotated[Items[TruthImage], Field(max_length=3)] = Field(
        default=(), exclude_if=is_empty
    )
    """Images of truth in addition to classes and depths: `instance` has the id of the actor in each
    pixel, `normal` the direction of its surface, `flow` the place of its point in the next image,
    and whether the next image shows it."""
    mounts: Annotated[Items[Mount], Field(min_length=1, max_length=8)]
    """Pose of each camera of this kind."""

    @model_validator(mode="after")
    def _check_calibration(self) -> Self:
        if self.calibration is None and self.calibrated_camera is not None:
            message, hint = "has no effect without `calibration`", "name the file of the chain"
            raise InvalidCombination(("calibrated_camera",), message, hint)
        if self.calibration is not None and self.intrinsics is None:
            message, hint = "names a file, which has not been read", "load the rig from its file"
            raise InvalidCombination(("calibration",), message, hint)
        return self

    @model_validator(mode="after")
    def _check_intrinsics(self) -> Self:
        given = self.intrinsics
        if given is None:
            return self
        if "horizontal_fov_deg" in self.model_fields_set:
            message, hint = "follows from `intrinsics`", "leave out one of both"
            raise InvalidCombination(("horizontal_fov_deg",), message, hint)
        for name, place, side in (
            ("cx_px", given.cx_px, self.width_px),
            ("cy_px", given.cy_px, self.height_px),
        ):
            if place > side - 1:
                message = f"{name} is not in the image, whose pixels are 0 to {side - 1}"
                hint = "give the size of the calibrated image"
                raise InvalidCombination(("intrinsics", name), message, hint)
        if not 1 / MAX_PIXEL_ASPECT <= self.pixel_aspect <= MAX_PIXEL_ASPECT:
            message = f"fy_px differs from fx_px by more than a factor of {MAX_PIXEL_ASPECT:g}"
            raise InvalidCombination(("intrinsics", "fy_px"), message, "is one of both mistyped?")
        return self

    @model_validator(mode="after")
    def _check_rendered_size(self) -> Self:
        if self.lens is None and self.intrinsics is None:
            return self
        place = "intrinsics" if self.lens is None else "lens"
        smaller = "horizontal_fov_deg" if self.intrinsics is None else "image"
        try:
            edge_rad = self.edge_angle_rad
        except ValueError as error:
            hint = f"check its coefficients, give a smaller {smaller}, or mount several cameras"
            raise InvalidCombination((place,), str(error), hint) from error
        if edge_rad > MAX_PINHOLE_EDGE_RAD and self.lens is None:
            message = f"shows {2 * math.degrees(edge_rad):.1f} deg from corner to corner"
            hint = "give the `lens` of the calibration, too"
            raise InvalidCombination((place,), message, hint)
        reach = math.tan(edge_rad)
        rendered_px = round(2 * reach * self.focal_px * max(1.0, self.pixel_aspect))
        if rendered_px > MAX_RENDERED_PX:
            message = f"needs {rendered_px} pixels across to render, more than {MAX_RENDERED_PX}"
            hint = f"give a smaller width_px or {smaller}"
            raise InvalidCombination((place,), message, hint)
        return self

    @model_validator(mode="after")
    def _check_point_spread(self) -> Self:
        if self.point_spread is None:
            return self
        limit_mrad = 1000 * MAX_SPREAD_PX / self.focal_px
        if self.point_spread.corner_mrad > limit_mrad:
            place = "point_spread", "corner_mrad"
            message = f"is more than {MAX_SPREAD_PX:g} pixels of this camera"
            raise InvalidCombination(place, message, f"give at most {limit_mrad:.2g}")
        return self

    @model_validator(mode="after")
    def _check_combined_exposures(self) -> Self:
        if self.combined_exposures > 1 and self.highlights_ev == 0:
            message, hint = (
                "has no effect without highlights_ev",
                "give the stops resolved by the exposures",
            )
            raise InvalidCombination(("combined_exposures",), message, hint)
        return self

    @model_validator(mode="after")
    def _check_raw_highlights(self) -> Self:
        if self.raw is not None and self.raw.highlights_ev > self.highlights_ev:
            message = f"is more than the sensor resolves, {self.highlights_ev:g}"
            hint = f"give at most {self.highlights_ev:g}, or the camera more `highlights_ev`"
            raise InvalidCombination(("raw", "highlights_ev"), message, hint)
        return self

    @model_validator(mode="after")
    def _check_flow(self) -> Self:
        if "flow" in self.truth and self.is_rolling:
            message = "cannot be measured between images of a rolling shutter"
            hint = "leave out `flow`, or `readout_ms` of the shutter"
            raise InvalidCombination(("truth",), message, hint, other_path=("shutter",))
        return self

    @model_validator(mode="after")
    def _check_flow_rate(self) -> Self:
        if "flow" in self.truth and self.rate_hz is not None:
            message = "cannot be measured for a camera with a rate of its own"
            hint = "leave out `flow`, or `rate_hz`"
            raise InvalidCombination(("truth",), message, hint, other_path=("rate_hz",))
        return self

    @model_validator(mode="after")
    def _check_readout_time(self) -> Self:
        if self.shutter is None or self.rate_hz is None:
            return self
        period_ms = 1000 / self.rate_hz
        if self.shutter.readout_ms > period_ms:
            message = f"is longer than from image to image, {period_ms:g} ms"
            hint = f"give at most that, or a lower rate_hz than {self.rate_hz:g}"
            place = ("shutter", "readout_ms")
            raise InvalidCombination(place, message, hint, other_path=("rate_hz",))
        return self

    @model_validator(mode="after")
    def _check_blurred_time(self) -> Self:
        has_blur = self.shutter is not None and self.shutter.blur_samples > 1
        if has_blur and self.exposure.shutter_s > MAX_BLURRED_S:
            message = f"is longer than {MAX_BLURRED_S:g} s, for which motion is known to blur"
            hint = "give less, or no blur_samples"
            raise InvalidCombination(("exposure", "shutter_s"), message, hint)
        return self

    @property
    def sensor_values(self) -> RawOutput:
        """Coding of the pixel values written by `raw` and read by `isp`."""
        of_isp = {"bits": 16, "black_level": 1024, "highlights_ev": self.highlights_ev}
        return self.raw or RawOutput.model_validate(of_isp)

    @property
    def is_rolling(self) -> bool:
        """Whether its rows are exposed one after the other."""
        return self.shutter is not None and self.shutter.readout_ms > 0

    @property
    def renders(self) -> int:
        """Images rendered for one image of this camera."""
        if self.shutter is None:
            return 1
        bands = self.shutter.bands if self.is_rolling else 1
        return bands * self.shutter.blur_samples + self.is_metered_first

    @property
    def has_moments(self) -> bool:
        """Whether its images show other moments than the frame's instant without flicker."""
        has_flicker = self.shutter is not None and self.shutter.led_flicker
        return self.renders > 1 or has_flicker or self.rate_hz is not None

    @property
    def is_metered_first(self) -> bool:
        """Whether a first image meters the exposure, on which blur and flicker depend."""
        shutter, is_self_exposing = self.shutter or Shutter(), self.exposure.mode == "sensor"
        return is_self_exposing and (shutter.blur_samples > 1 or shutter.led_flicker)

    @property
    def focal_px(self) -> float:
        """Focal length in widths of a pixel, of an image of `width_px`."""
        if self.intrinsics is not None:
            return self.intrinsics.fx_px
        half_rad = math.radians(self.horizontal_fov_deg / 2)
        reach = math.tan(half_rad) if self.lens is None else self.lens.compute_radius(half_rad)
        return self.width_px / (2 * reach)

    @property
    def pixel_aspect(self) -> float:
        """Width of a pixel over its height."""
        return self.intrinsics.fy_px / self.intrinsics.fx_px if self.intrinsics else 1.0

    @property
    def centre_px(self) -> tuple[float, float]:
        """Column and row of the principal point; the corner of the upper left pixel is (0, 0)."""
        if self.intrinsics is None:
            return self.width_px / 2, self.height_px / 2
        return self.intrinsics.cx_px + 0.5, self.intrinsics.cy_px + 0.5

    @property
    def more_images(self) -> tuple[str, ...]:
        """Kinds of images written in addition to the images of every camera."""
        asked = {"hdr": self.hdr, "raw": self.raw is not None}
        return (*self.truth, *(kind for kind, is_asked in asked.items() if is_asked))

    @property
    def side_angles_rad(self) -> tuple[float, float]:
        """Angles off the axis at the left and the right edge of the image."""
        if self.intrinsics is None:
            half_rad = math.radians(self.horizontal_fov_deg / 2)
            return half_rad, half_rad
        column = self.centre_px[0]
        left, right = (side / self.focal_px for side in (column, self.width_px - column))
        if self.lens is None:
            return math.atan(left), math.atan(right)
        return find_edge_angle(self.lens, left), find_edge_angle(self.lens, right)

    @property
    def edge_angle_rad(self) -> float:
        """Angle off the axis within which all rays of the image are."""
        column, row = self.centre_px
        right = max(column, self.width_px - column)
        down = max(row, self.height_px - row) / self.pixel_aspect
        corner_radius = math.hypot(right, down) / self.focal_px
        if self.lens is None:
            return math.atan(corner_radius)
        least_rad = math.radians(self.horizontal_fov_deg / 2) if self.intrinsics is None else 0.0
        return find_edge_angle(self.lens, corner_radius, least_rad)
