"""The image signal processor of a camera: makes an image of the values of a sensor's pixels.

Sums are of whole numbers and exact, and demosaicing and JPEG compute in whole numbers, so images
are the same on every machine.
"""

import math

import cv2
import numpy as np
from advercity_dsl import Camera, Isp
from numpy.typing import NDArray

from advercity.sensors.camera.electronics import (
    COLOUR_CHANNELS,
    HIGHLIGHT_STEP,
    MAX_DN,
    WHITE_DN,
    build_tone_curve,
    compute_raw_variance,
    find_brightest_ev,
)
from advercity.sensors.measurements import CameraReadout

Image = NDArray[np.uint8]

DENOISED_PX = 5
"""Width of the squares, of pixels of one filter, for the mean and variance of the denoising."""
BLACK_VALUE, FULL_VALUE = 4096, 65_535
"""Values of the dark and of the brightest light for demosaicing; noise goes below black."""
LUMA_WEIGHTS = (77, 150, 29)
"""Weights of red, green and blue in 256ths (BT.601, as in JPEG)."""


def develop_raw(
    values: NDArray[np.uint16], camera: Camera, readout: CameraReadout
) -> NDArray[np.uint8]:
    """Make the image (h, w, 3), RGB, of the values (h, w) of a sensor's pixels.

    Stages follow `camera.isp`, by default `isp: {}`; their formulas are in `docs/cameras.md`.
    The `raw` values of a dataset give exactly its image.

    Args:
        values: As `camera.raw` describes them.
        camera: The declaration of the camera.
        readout: Readout of the same image.
    """
    isp = camera.isp or Isp()
    balanced = _balance_white(values, camera, readout, isp.denoise)
    edge_aware = "_EA" if isp.demosaic == "edge_aware" else ""
    code = getattr(cv2, f"COLOR_Bayer{camera.sensor_values.pattern.upper()}2RGB{edge_aware}")
    colours = np.asarray(cv2.demosaicing(balanced, code), np.uint16)
    image = _map_tones(colours, camera, readout)
    if isp.sharpening > 0:
        image = _sharpen(image, isp.sharpening)
    return image if isp.jpeg_quality is None else _compress(image, isp.jpeg_quality)


def _balance_white(
    values: NDArray[np.uint16], camera: Camera, readout: CameraReadout, denoise: float
) -> NDArray[np.uint16]:
    """Denoise the values (h, w) of each filter and scale them to make grey even."""
    raw = camera.sensor_values
    step = (FULL_VALUE - BLACK_VALUE) / (raw.full_value - raw.black_level)
    balanced = np.empty_like(values)
    for place, colour in enumerate(raw.pattern):
        every = slice(place // 2, None, 2), slice(place % 2, None, 2)
        plane = np.ascontiguousarray(values[every])
        light = _denoise(plane, camera, readout, denoise) if denoise > 0 else plane
        white = readout.white_point[COLOUR_CHANNELS.index(colour)]
        factor = np.float32(step * max(readout.white_point) / white)
        shifted = (light - np.float32(raw.black_level)) * factor + np.float32(BLACK_VALUE)
        balanced[every] = np.clip(np.rint(shifted), 0, FULL_VALUE)
    return balanced


def _denoise(
    plane: NDArray[np.uint16], camera: Camera, readout: CameraReadout, fraction: float
) -> NDArray[np.float32]:
    """Remove a fraction of the noise from even surfaces, and less the more a surface varies.

    Lee's filter (1980) with the sensor's noise at the mean of each square.
    """
    size, border = (DENOISED_PX, DENOISED_PX), cv2.BORDER_REFLECT
    # Sums of whole numbers are exact in any order.
    sums = cv2.boxFilter(plane, cv2.CV_64F, size, normalize=False, borderType=border)
    squares = cv2.sqrBoxFilter(plane, cv2.CV_64F, size, normalize=False, borderType=border)
    mean = sums / DENOISED_PX**2
    found = ((squares - sums * mean) / (DENOISED_PX**2 - 1)).astype(np.float32)
    raw = camera.sensor_values
    step_e = readout.full_well_e * 2.0**raw.highlights_ev / (raw.full_value - raw.black_level)
    electrons = (np.maximum(mean - raw.black_level, 0.0) * step_e).astype(np.float32)
    rounding = np.float32(1 / 12)
    noise = compute_raw_variance(electrons, camera, readout) / np.float32(step_e**2) + rounding
    kept = found / (found + np.float32(fraction / (1.0 - fraction)) * noise)
    return (mean + kept * (plane - mean)).astype(np.float32)


def _map_tones(colours: NDArray[np.uint16], camera: Camera, readout: CameraReadout) -> Image:
    """Show the colours (h, w, 3) by the tone curve of images without an ISP."""
    # The brightest grey within the range of the values of all filters. If it is darker than a full
    # pixel, as in a sensor without highlights, it is shown as white.
    ends = 2.0**camera.sensor_values.highlights_ev / max(readout.white_point)
    brightest = max(ends, 1.0)
    linear = (np.arange(FULL_VALUE + 1) - BLACK_VALUE) * (brightest / (FULL_VALUE - BLACK_VALUE))
    sampled = linear.take(colours[::HIGHLIGHT_STEP, ::HIGHLIGHT_STEP])
    curve = build_tone_curve(find_brightest_ev(sampled, math.log2(brightest)))
    digital = np.clip(np.rint(linear * WHITE_DN), 0, MAX_DN).astype(np.intp)
    return curve[digital].take(colours)


def _sharpen(image: Image, overshoot: float) -> Image:
    """Add to each pixel (h, w, 3) the difference between its luma and its neighbours'.

    At a sharp edge along rows or columns this is a quarter of its height on both sides.
    """
    luma = image @ np.array(LUMA_WEIGHTS, np.float32)
    # Sums of whole numbers below 2**24 are exact.
    kernel = np.array([1, 2, 1], np.float32)
    blurred = cv2.sepFilter2D(luma, -1, kernel, kernel, borderType=cv2.BORDER_REFLECT)
    detail = (16 * luma - blurred) * np.float32(4 * overshoot / 16 / sum(LUMA_WEIGHTS))
    return np.clip(np.rint(image + detail[..., None]), 0, 255).astype(np.uint8)


def _compress(image: Image, quality: int) -> Image:
    """Compress the image (h, w, 3) to JPEG and read it again."""
    flags = [cv2.IMWRITE_JPEG_QUALITY, quality]
    _, encoded = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), flags)
    return np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR_RGB), np.uint8)
