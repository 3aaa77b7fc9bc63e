"""Images of materials on the device, and their lookup.

All images with their smaller copies (mipmaps) are in one buffer: a kernel is the same for any
number of them. A texel is two words: colour (sRGB) and roughness, and x and y of the normal.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float32Array
from advercity.material_maps import LINEAR_FROM_SRGB, MaterialMaps
from advercity.materials import Texture
from advercity_mitsuba.noise import hash_cell
from advercity_mitsuba.variant import dr, mi

WORDS = 2
HEADER = 8
"""Numbers of an image: width, height, levels, 0; factors of colour (3) and roughness."""
MAX_STRETCH = 4.0
"""How many times wider than its mipmap's texels a sample may see; more samples blur the rest."""
ORDERED_TEXTURES = (
    Texture.BRICK,
    Texture.TILES,
    Texture.SLABS,
    Texture.WOOD,
    Texture.PLAIN,
)
"""Courses of bricks may not overlap, nor may images of models, whose materials have no pattern."""
_NEUTRAL = 127.5
_SRGB_STEPS = (LINEAR_FROM_SRGB[1:] + LINEAR_FROM_SRGB[:-1]) / 2.0


@dataclass(frozen=True, eq=False)
class DeviceImages:
    """Images on the device: words of all texels, and first texel and header of each."""

    texels: Any
    firsts: Any
    headers: Any
    linear: Any


def upload_images(maps: Mapping[str, MaterialMaps], names: Sequence[str]) -> DeviceImages:
    """Copy the images of some names to the device."""
    headers: list[list[float]] = []
    words: list[NDArray[np.uint32]] = []
    firsts = [0]
    for name in names:
        own = maps[name]  # is read from a file
        levels = _build_levels(own)
        height, width = levels[0].shape[:2]
        # Roughness is a byte of its own scale, colours are of light.
        factors = _compute_factors(own)
        headers.append([float(width), float(height), float(len(levels)), 0.0, *factors])
        words += [level.reshape(-1) for level in levels]
        firsts.append(firsts[-1] + sum(level.shape[0] * level.shape[1] for level in levels))
    everything = np.concatenate(words) if words else np.zeros(WORDS, np.uint32)
    values = headers or [[0.0] * HEADER]
    images = DeviceImages(
        mi.UInt32(everything),
        mi.UInt32(np.array(firsts, np.uint32)),
        mi.Float(np.array(values, np.float32).ravel()),
        mi.Float(LINEAR_FROM_SRGB.astype(np.float32)),
    )
    dr.make_opaque(images.texels, images.firsts, images.headers, images.linear)
    return images


def _compute_factors(maps: MaterialMaps) -> list[float]:
    """Compute the factors from colour (linear) and roughness to ratios to their means."""
    linear = LINEAR_FROM_SRGB
    counts = [np.bincount(maps.color[..., n].ravel(), minlength=256) for n in range(3)]
    measured = [float(count @ linear / count.sum()) for count in counts]
    means = maps.mean or measured
    factors = [1.0 / max(mean, 1e-6) for mean in means]
    rough = 1.0 if maps.roughness is None else float(maps.roughness.mean()) / 255.0
    return [*factors, 1.0 / max(rough, 1e-6)]


def _build_levels(maps: MaterialMaps) -> list[NDArray[np.uint32]]:
    """Pack an image and its halves, down to one whose shorter side is a texel."""
    size = maps.color.shape[:2]
    tone = np.full((*size, 4), 255, np.uint8)
    tone[..., :3] = maps.color[..., :3]
    if maps.roughness is not None:
        tone[..., 3] = maps.roughness
    relief = np.full((*size, 2), _NEUTRAL, np.float32)
    if maps.normal is not None:
        relief[...] = maps.normal[..., :2]
    levels = [_pack(tone, relief)]
    light = tone.astype(np.float32)
    light[..., :3] = LINEAR_FROM_SRGB[tone[..., :3]]
    while min(light.shape[:2]) > 1:
        light, relief = _halve(light), _halve(relief)
        # Colours are averaged as light, the rest as it is.
        bytes_ = np.searchsorted(_SRGB_STEPS, light[..., :3])
        levels.append(_pack(np.dstack([bytes_, np.round(light[..., 3:])]), relief))
    return levels


def _halve(image: Float32Array) -> Float32Array:
    size = image.shape[1] // 2, image.shape[0] // 2
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32, copy=False)


def _pack(tone: NDArray[Any], relief: Float32Array) -> NDArray[np.uint32]:
    """Pack colour and roughness (h, w, 4) in bytes, and a relief, to words (h, w, 2)."""
    bytes_ = np.ascontiguousarray(tone, np.uint8).view("<u4")
    slope = np.ascontiguousarray(np.round(2.0 * relief), "<u2").view("<u4")
    return np.concatenate([bytes_, slope], axis=-1)


@dataclass
class ImageSample:
    """Effects of images on a surface: factors of colour and roughness, and the relief's slope."""

    color: Any
    roughness: Any
    slope: Any


def is_unordered(kind: Any) -> Any:
    """Whether copies of an image may overlap."""
    found = mi.Bool(True)
    for texture in ORDERED_TEXTURES:
        found &= kind != int(texture)
    return found


def sample_images(
    images: DeviceImages,
    number: Any,
    *,
    at: Any,
    width_m: Any,
    kind: Any,
    cosine: Any,
    pixel_m: Any,
    active: Any,
) -> ImageSample:
    """Look up images without visible repetition.

    Args:
        images: Images on the device.
        number: Number of the image.
        at: Metres to the right and up on the surface.
        width_m: Width of the image.
        kind: Number of the material's `Texture`.
        cosine: Cosine of the angle of incidence.
        pixel_m: Width of a pixel at the surface, across the ray.
        active: Whether there is an image.
    """
    row = mi.UInt32(dr.maximum(number, 0.0))
    low = dr.gather(mi.Vector4f, images.headers, 2 * row, active)
    factors = dr.gather(mi.Vector4f, images.headers, 2 * row + 1, active)
    width, height, levels = low.x, low.y, low.z
    stretch = dr.minimum(1.0 / dr.maximum(cosine, 0.02), MAX_STRETCH * MAX_STRETCH)
    fine = dr.maximum(1.0, stretch / MAX_STRETCH)
    level = dr.log2(dr.maximum(pixel_m * fine / width_m * width, 1e-6))
    seen = active & (level <= levels - 2.0)
    level = mi.UInt32(dr.clip(dr.round(level), 0.0, dr.maximum(levels - 1.0, 0.0)))
    # The texels of all larger levels: a geometric series.
    texels = width * height
    before = texels * (4.0 / 3.0) * (1.0 - dr.exp2(-2.0 * mi.Float(level)))
    start = dr.gather(mi.UInt32, images.firsts, row, active) + mi.UInt32(before + 0.5)
    size = mi.Vector2u(mi.UInt32(width) >> level, mi.UInt32(height) >> level)
    # Rows of images run downwards.
    uv = mi.Point2f(at.x, -at.y * width / height) / width_m

    def fetch(coordinate: Any, where: Any) -> ImageSample:
        return _fetch(images, start, size, factors, coordinate, where)

    mixed = is_unordered(kind)
    plain = fetch(uv, seen & ~mixed)
    blended = _blend_copies(fetch, uv, seen & mixed)
    return ImageSample(
        dr.select(seen, dr.select(mixed, blended.color, plain.color), 1.0),
        dr.select(seen, dr.select(mixed, blended.roughness, plain.roughness), 1.0),
        dr.select(seen, dr.select(mixed, blended.slope, plain.slope), 0.0),
    )


def _fetch(
    images: DeviceImages, start: Any, size: Any, factors: Any, uv: Any, active: Any
) -> ImageSample:
    """Interpolate between four texels."""
    place = mi.Point2f(uv - dr.floor(uv)) * mi.Point2f(size) - 0.5
    corner = dr.floor(place)
    f = place - corner
    corner = mi.Vector2i(corner)
    color, roughness, slope = mi.Color3f(0.0), mi.Float(0.0), mi.Vector2f(0.0)
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        # Sizes are powers of two, and images repeat.
        column = mi.UInt32(corner.x + dx) & (size.x - 1)
        row = mi.UInt32(corner.y + dy) & (size.y - 1)
        word = dr.gather(mi.Vector2u, images.texels, start + row * size.x + column, active)
        weight = (f.x if dx else 1.0 - f.x) * (f.y if dy else 1.0 - f.y)
        color += weight * mi.Color3f(
            *(
                dr.gather(mi.Float, images.linear, (word.x >> shift) & 255, active)
                for shift in (0, 8, 16)
            )
        )
        roughness += weight * mi.Float(word.x >> 24)
        slope += weight * mi.Vector2f(mi.Float(word.y & 0xFFFF), mi.Float(word.y >> 16))
    return ImageSample(
        color * mi.Color3f(factors.x, factors.y, factors.z),
        roughness / 255.0 * factors.w,
        slope / 255.0 - 1.0,
    )


def _blend_copies(fetch: Any, uv: Any, active: Any) -> ImageSample:
    """Blend copies at random places around the corners of a lattice of triangles.

    Their variance stays the variance of one image (Heitz and Neyret 2018).
    """
    triangles, sharpness = 1.6, 5.0
    p = uv * triangles
    skewed = mi.Point2f(p.x - 0.57735027 * p.y, 1.15470054 * p.y)
    cell = dr.floor(skewed)
    f = skewed - cell
    corner = mi.Vector2i(cell)
    upper = f.x + f.y > 1.0
    weights = dr.select(
        upper,
        mi.Vector3f(f.x + f.y - 1.0, 1.0 - f.y, 1.0 - f.x),
        mi.Vector3f(1.0 - f.x - f.y, f.y, f.x),
    )
    weights = weights**sharpness
    weights /= dr.sum(weights)
    color, roughness, slope = mi.Color3f(0.0), mi.Float(0.0), mi.Vector2f(0.0)
    corners = ((1, 1), (0, 0)), ((1, 0), (0, 1)), ((0, 1), (1, 0))
    for weight, (high, low) in zip(weights, corners, strict=True):
        x = corner.x + dr.select(upper, mi.Int32(high[0]), low[0])
        y = corner.y + dr.select(upper, mi.Int32(high[1]), low[1])
        moved = uv + mi.Point2f(hash_cell(x, y, 301), hash_cell(x, y, 302))
        found = fetch(moved, active & (weight > 0.02))
        color += dr.select(weight > 0.02, weight * (found.color - 1.0), 0.0)
        roughness += dr.select(weight > 0.02, weight * (found.roughness - 1.0), 0.0)
        slope += dr.select(weight > 0.02, weight * found.slope, 0.0)
    contrast = dr.rsqrt(dr.dot(weights, weights))
    return ImageSample(
        dr.maximum(1.0 + contrast * color, 0.0),
        dr.maximum(1.0 + contrast * roughness, 0.0),
        contrast * slope,
    )
