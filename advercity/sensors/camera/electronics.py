"""Turns light on the sensor into an image: exposure, white balance, noise and tone.

The chain is EMVA 1288's linear camera with the exposure arithmetic of ISO 12232. The sensor also
resolves highlights above saturation, as automotive sensors do.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from advercity_dsl import Camera, Exposure
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.photometry import (
    BLACK_BODY_COLOURS,
    BLACK_BODY_TEMPERATURES_K,
    LED_COLOUR,
    LUMINANCE_WEIGHTS,
    black_body_colour,
    cubemap_directions,
    cubemap_solid_angles,
)
from advercity.sensors.measurements import HDR_FULL_VALUE, CameraReadout

WHITE_DN = HDR_FULL_VALUE
MAX_DN = 16 * WHITE_DN
"""Largest value of a sensor with four stops of highlights."""
MIDDLE_GREY = 0.18
"""Fraction of a full pixel up to which the tone curve is plain sRGB."""
FULL_WELL_E = 10_000.0
"""Electrons of a full pixel at ISO 100."""
READ_NOISE_E = 3.0
METER_CONSTANT = 12.5
"""Calibration constant of a reflected-light meter (ISO 2720), cd s/(m² ISO)."""
HEADROOM = 1.2
"""Saturation luminance at EV100 of 0: H_sat = 78 / ISO with q = 0.65."""
AUTO_EV100_RANGE = (2.0, 15.5)
"""Range of automatic exposure."""
MIN_SHUTTER_S, MAX_SHUTTER_S = 20e-6, 1.0 / 30.0
"""Shutter range of a self-exposing sensor: up to a frame of a camera of 30 Hz."""
BASE_ISO, MAX_ISO = 100.0, 10_000.0
"""Gain range of a self-exposing sensor: from a full well that fills the converter to the end of
`auto` at f/1.4 and 1/200 s."""
METERED_FROM_ROW = 1 / 3
"""Fraction of the rows, from the top, ignored by the meter: the sky."""
METERED_PERCENTILE = 98.0
HIGHLIGHT_PERCENTILE = 98.0
"""Percentile of pixels shown as white by the tone curve; brighter ones are lamps and the sun."""
HIGHLIGHT_STEP = 4
"""Step of the rows and columns sampled for it."""
NEUTRAL_WHITE = np.ones(3)
_MIN_METERED_CD_M2 = 1e-5
_LUMINANCE_WEIGHTS_32 = LUMINANCE_WEIGHTS.astype(np.float32)
DAY_WHITE_RANGE_K = (5500.0, 7500.0)
NIGHT_WHITE_RANGE_K = (3500.0, 7500.0)
"""Ranges of white; yellower or bluer scenes stay so, as in dust and under a low sun."""
SWITCH_FRACTION = 0.9
"""Fraction of a full pixel from which the next shorter exposure is taken, with room for noise."""
COLOUR_CHANNELS = "rgb"
"""Letters of the colours in names of filter patterns, by channel."""


@lru_cache(maxsize=64)
def build_tone_curve(brightest_ev: float) -> NDArray[np.uint8]:
    """Build the table (MAX_DN + 1,) from converter values to 8-bit values of the image.

    `brightest_ev` is in stops above a full pixel. At 0 the curve is sRGB. Otherwise values above
    middle grey roll off towards white as on film, by Reinhard's extended curve (2002), which has
    slope 1 at middle grey and is white at the brightest value.
    """
    linear = np.arange(MAX_DN + 1) / WHITE_DN
    brightest = 2.0**brightest_ev
    shown = np.minimum(_roll_off_highlights(np.minimum(linear, brightest), brightest), 1.0)
    encoded = np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - 0.055)
    return np.rint(encoded * 255.0).astype(np.uint8)


def _roll_off_highlights(linear: NDArray[np.float64], brightest: float) -> NDArray[np.float64]:
    span = 1.0 - MIDDLE_GREY
    above = np.maximum(linear - MIDDLE_GREY, 0.0) / span
    full = (brightest - MIDDLE_GREY) / span
    return np.minimum(linear, MIDDLE_GREY) + span * above * (1.0 + above / full**2) / (1.0 + above)


@dataclass(frozen=True)
class ExposureSettings:
    """Exposure of one image."""

    ev100: float
    iso: float
    shutter_s: float
    binned_pixels: float = 1.0
    """Number of the sensor's pixels in one of the image."""
    highlights_ev: float = 0.0
    """Stops above saturation resolved by the sensor's short exposures."""
    combined_exposures: int = 1
    """Number of the sensor's exposures, including the long one."""

    @property
    def saturation_cd_m2(self) -> float:
        """Least luminance of a full pixel in the long exposure."""
        return HEADROOM * 2.0**self.ev100

    @property
    def full_well_e(self) -> float:
        """Electrons of a full pixel: fewer with more gain, more with larger pixels."""
        return FULL_WELL_E * self.binned_pixels * BASE_ISO / self.iso

    @property
    def read_noise_e(self) -> float:
        """Read noise in electrons of all the sensor's pixels in one of the image."""
        return READ_NOISE_E * math.sqrt(self.binned_pixels)


def meter_exposure(
    radiance: NDArray[np.float32], exposure: Exposure, *, white_card_cd_m2: float = math.inf
) -> ExposureSettings:
    """Choose the settings for an image (h, w, 3) in cd/m² in the mode of `exposure`.

    Manual exposure follows from f-number, shutter and ISO. Automatic exposure puts the log-average
    of the lower two thirds, without highlights, at middle grey; a grey filter removes surplus light
    and gain makes up for missing light, so the shutter stays as authored. A self-exposing sensor
    moves the shutter as far as it can, and then its gain.

    Scenes lighter than a grey card in the same light, as in snow and fog, stay lighter;
    `white_card_cd_m2` is a white card on open ground, inf if the camera cannot know it.
    """
    authored = exposure_value(exposure)
    if exposure.mode == "manual":
        return ExposureSettings(authored, exposure.iso, exposure.shutter_s)
    metered = min(_metered_luminance(radiance), MIDDLE_GREY * white_card_cd_m2)
    target_ev100 = math.log2(metered * 100.0 / METER_CONSTANT) - exposure.compensation_ev
    if exposure.mode == "sensor":
        return _choose_shutter_then_gain(target_ev100, exposure)
    ev100 = min(max(target_ev100, AUTO_EV100_RANGE[0]), AUTO_EV100_RANGE[1])
    iso = exposure.iso * 2.0 ** max(0.0, authored - ev100)
    return ExposureSettings(ev100, iso, exposure.shutter_s)


def exposure_value(exposure: Exposure) -> float:
    """Compute EV100 of f-number, shutter and ISO."""
    return math.log2(exposure.f_number**2 / exposure.shutter_s * 100.0 / exposure.iso)


def digitise(
    fill_fraction: NDArray[np.float32], setting: ExposureSettings, rng: np.random.Generator | None
) -> NDArray[np.uint16]:
    """Convert fractions of a full pixel to values of 12 bits and highlights.

    Shot noise is the normal approximation to Poisson's law, read noise is normal; without a
    generator there is none. With several exposures, each value is taken from the longest exposure
    that is not full, so the ratio of signal to noise falls where the next takes over.
    """
    full_dn = WHITE_DN * 2.0**setting.highlights_ev
    digital = np.clip(fill_fraction * np.float32(WHITE_DN), 0.0, full_dn)
    if setting.combined_exposures > 1:
        ratios = _find_exposure_ratios(digital, setting)
        single = replace(setting, highlights_ev=0.0, combined_exposures=1)
        return np.rint(ratios * digitise(fill_fraction / ratios, single, rng)).astype(np.uint16)
    if rng is not None:
        # Variances in squared converter values: gain times signal, and read noise.
        gain = WHITE_DN / setting.full_well_e
        read_variance = np.float32((gain * setting.read_noise_e) ** 2)
        deviation = np.sqrt(np.float32(gain) * digital + read_variance)
        deviation *= _draw_normal(deviation.shape, rng)
        digital += deviation
        np.clip(digital, 0.0, full_dn, out=digital)
    return np.rint(digital, out=digital).astype(np.uint16)


def _find_exposure_ratios(
    digital: NDArray[np.float32], setting: ExposureSettings | Camera
) -> NDArray[np.float32]:
    """Return the ratio of the long exposure to the exposure of each value, in their shape."""
    last = setting.combined_exposures - 1
    between_ev = setting.highlights_ev / last
    over = digital / np.float32(SWITCH_FRACTION * WHITE_DN)
    count = np.ceil(np.log2(np.maximum(over, np.float32(1.0))) / np.float32(between_ev))
    return np.exp2(np.float32(between_ev) * np.minimum(count, last)).astype(np.float32)


def digitise_raw(
    light: NDArray[np.float32],
    camera: Camera,
    readout: CameraReadout,
    rng: np.random.Generator | None,
) -> NDArray[np.uint16]:
    """Convert light (h, w, 3) in cd/m² to values (h, w) of pixels behind filters of one colour.

    Values are of the long exposure up to a full pixel, or include the highlights of the camera's
    `sensor_values`, without white balance. Noise is as in `digitise`, down to 0 below the black
    level.
    """
    raw = camera.sensor_values
    electrons = _select_filtered(light, raw.pattern) * np.float32(
        readout.full_well_e / readout.saturation_cd_m2
    )
    largest_e = readout.full_well_e * 2.0**raw.highlights_ev
    np.minimum(electrons, np.float32(largest_e), out=electrons)
    if rng is not None:
        deviation = np.sqrt(compute_raw_variance(electrons, camera, readout))
        electrons += deviation * _draw_normal(electrons.shape, rng)
    step = np.float32((raw.full_value - raw.black_level) / largest_e)
    values = np.rint(electrons * step + np.float32(raw.black_level))
    return np.clip(values, 0, raw.full_value).astype(np.uint16)


def compute_raw_variance(
    electrons: NDArray[np.float32], camera: Camera, readout: CameraReadout
) -> NDArray[np.float32]:
    """Compute the variance of shot and read noise in squared electrons of the long exposure.

    A value of an r times shorter exposure counts r times its electrons.
    """
    read_variance = np.float32(readout.read_noise_e**2)
    if camera.combined_exposures == 1 or camera.sensor_values.highlights_ev == 0:
        return electrons + read_variance
    digital = electrons * np.float32(WHITE_DN / readout.full_well_e)
    ratios = _find_exposure_ratios(digital, camera)
    variance = ratios * (electrons + ratios * read_variance)
    return variance.astype(np.float32)


def _select_filtered(light: NDArray[np.float32], pattern: str) -> NDArray[np.float32]:
    """Select the channel (h, w) of light (h, w, 3) passed by each pixel's filter."""
    mosaic = np.empty(light.shape[:2], np.float32)
    for place, colour in enumerate(pattern):
        every = slice(place // 2, None, 2), slice(place % 2, None, 2)
        mosaic[every] = light[every][..., COLOUR_CHANNELS.index(colour)]
    return mosaic


def _draw_normal(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    levels = np.frombuffer(rng.bytes(2 * math.prod(shape)), "<u2")
    return _NORMAL_TABLE.take(levels).reshape(shape)


def _choose_shutter_then_gain(wanted_ev100: float, exposure: Exposure) -> ExposureSettings:
    """Choose shutter and gain nearest to an EV100 with an open aperture."""
    longest_s = max(MAX_SHUTTER_S, exposure.shutter_s)
    wanted_iso_s = 100.0 * exposure.f_number**2 / 2.0**wanted_ev100
    shutter_s = min(max(wanted_iso_s / exposure.iso, MIN_SHUTTER_S), longest_s)
    least_iso, most_iso = min(BASE_ISO, exposure.iso), max(MAX_ISO, exposure.iso)
    iso = min(max(wanted_iso_s / shutter_s, least_iso), most_iso)
    chosen = exposure.model_copy(update={"shutter_s": shutter_s, "iso": iso})
    return ExposureSettings(exposure_value(chosen), iso, shutter_s)


def _metered_luminance(radiance: NDArray[np.float32]) -> float:
    first_row = int(len(radiance) * METERED_FROM_ROW)
    luminance = radiance[first_row:] @ _LUMINANCE_WEIGHTS_32
    luminance = np.maximum(luminance, np.float32(_MIN_METERED_CD_M2))
    limit = np.percentile(luminance, METERED_PERCENTILE)
    return float(np.exp(np.log(luminance[luminance <= limit]).mean(dtype=np.float64)))


def find_brightest_ev(sampled: NDArray[np.floating], highlights_ev: float) -> float:
    """Compute the stops of an image's highlights above a full pixel, at most `highlights_ev`.

    `sampled` (h, w, 3) are pixels of the image, `HIGHLIGHT_STEP` apart, in full pixels. The result
    is rounded up to eighths, so few tone curves are built.
    """
    highlights = np.percentile(sampled.max(axis=2), HIGHLIGHT_PERCENTILE)
    return min(max(0.0, math.ceil(8.0 * math.log2(max(highlights, 1.0))) / 8.0), highlights_ev)


def _build_normal_table() -> NDArray[np.float32]:
    """Build 65,536 equally likely normal quantiles with mean 0 and deviation 1."""
    x = np.linspace(-5.0, 5.0, 2**16)
    cumulative = np.cumsum(np.exp(-0.5 * x**2))
    found = np.interp((np.arange(2**16) + 0.5) / 2**16, cumulative / cumulative[-1], x)
    found -= found.mean()
    return (found / found.std()).astype(np.float32)


_NORMAL_TABLE = _build_normal_table()


def find_white_point(atmosphere: Atmosphere) -> Float64Array:
    """Find the colour (3,) at luminance 1 shown as grey by the camera.

    It is the black body, within the camera's range, nearest to the light of sun, sky and, by night,
    street lamps on level ground. Other casts, such as green, stay.
    """
    illuminant = _ground_illuminance(atmosphere)
    low_k, high_k = NIGHT_WHITE_RANGE_K if atmosphere.night else DAY_WHITE_RANGE_K
    temperature = np.clip(_find_black_body_temperature_k(illuminant), low_k, high_k)
    return black_body_colour(float(temperature))


def _ground_illuminance(atmosphere: Atmosphere) -> Float64Array:
    sky = atmosphere.sky.astype(np.float64)
    size = sky.shape[1]
    weight = np.maximum(cubemap_directions(size)[..., 2], 0.0) * cubemap_solid_angles(size)
    # No matrix product: OpenBLAS sums in another order for every number of threads.
    diffuse = np.einsum("fij,fijc->c", weight, sky)
    direct = atmosphere.sun_lx * max(0.0, float(atmosphere.sun_direction[2]))
    sun = direct * np.asarray(atmosphere.sun_colour)
    return diffuse + sun + atmosphere.street_lx * np.asarray(LED_COLOUR)


def _find_black_body_temperature_k(illuminant: Float64Array) -> float:
    """Find the temperature of the black body with the same ratio of red to blue, in K."""
    red, _, blue = np.maximum(illuminant, 1e-12)
    ratio = np.log(BLACK_BODY_COLOURS[:, 0] / BLACK_BODY_COLOURS[:, 2])
    found = np.interp(-np.log(red / blue), -ratio, 1e6 / BLACK_BODY_TEMPERATURES_K)
    return float(1e6 / found)
