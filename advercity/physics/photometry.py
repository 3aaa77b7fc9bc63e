"""Photometry: colours, luminance, and integrals over cubemaps.

Colours are linear sRGB; a `Colour` has luminance 1 unless a docstring says otherwise.
"""

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float32Array, Float64Array, FloatArray

Colour = tuple[float, float, float]
LED_COLOUR: Colour = (1.39, 0.94, 0.50)
"""White LEDs of street lamps, 4000 K."""
HALOGEN_COLOUR: Colour = (1.68, 0.87, 0.33)
"""Halogen headlamps, 3200 K."""
LED_HEADLAMP_COLOUR: Colour = (1.08, 0.99, 0.86)
"""Headlamps of LEDs, 5700 K."""

LUMINANCE_WEIGHTS = np.array([0.2126, 0.7152, 0.0722])
"""Luminance of the linear sRGB primaries (ITU-R BT.709)."""
_RIGHT_OF_FACE = np.array(
    [[0, -1, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0], [0, -1, 0], [0, -1, 0]], float
)
_DOWN_OF_FACE = np.array([[0, 0, -1]] * 4 + [[1, 0, 0], [-1, 0, 0]], float)
_RGB_FROM_XYZ = np.array(
    [
        [3.2406, -1.5372, -0.4986],
        [-0.9689, 1.8758, 0.0415],
        [0.0557, -0.2040, 1.0570],
    ]
)


def cubemap_directions(size: int) -> Float64Array:
    """Directions (6, size, size, 3) of the texels of a cubemap, laid out as `Atmosphere.sky`."""
    return _spread_over_faces((np.arange(size) + 0.5) / size * 2.0 - 1.0)


def _spread_over_faces(axis: Float64Array) -> Float64Array:
    """Spread directions (6, n, n, 3) over faces whose edges are at -1 and 1 of an axis (n,)."""
    down, right = np.meshgrid(axis, axis, indexing="ij")
    one = np.ones_like(right)
    faces = np.stack(
        [
            np.stack([one, -right, -down], axis=-1),
            np.stack([-one, right, -down], axis=-1),
            np.stack([right, one, -down], axis=-1),
            np.stack([-right, -one, -down], axis=-1),
            np.stack([down, -right, one], axis=-1),
            np.stack([-down, -right, -one], axis=-1),
        ]
    )
    return faces / np.linalg.norm(faces, axis=-1, keepdims=True)


def stack_cubemap(faces: Float32Array) -> Float32Array:
    """Stack the faces of a cubemap below each other, each with a border for filters to run over.

    Args:
        faces: (6, n, n, c), laid out as `Atmosphere.sky`.

    Returns:
        (6 (n + 2), n + 2, c): each face with a border of its neighbours' texels.
    """
    size = faces.shape[1]
    directions = _spread_over_faces((np.arange(-1, size + 1) + 0.5) / size * 2.0 - 1.0)
    bordered = np.pad(faces, ((0, 0), (1, 1), (1, 1), (0, 0)))
    is_border = np.ones(bordered.shape[:3], bool)
    is_border[:, 1:-1, 1:-1] = False
    bordered[is_border] = _look_up_cubemap(faces, directions[is_border])
    return bordered.reshape(-1, size + 2, faces.shape[3])


def _look_up_cubemap(faces: Float32Array, directions: Float64Array) -> Float64Array:
    """Interpolate a cubemap (6, n, n, c) in directions (k, 3): (k, c)."""
    longest = np.argmax(np.abs(directions), axis=1)
    length = np.take_along_axis(directions, longest[:, None], axis=1)[:, 0]
    face = 2 * longest + (length < 0.0)
    size = faces.shape[1]
    low: list[NDArray[np.intp]] = []
    part: list[Float64Array] = []
    for axes in (_DOWN_OF_FACE, _RIGHT_OF_FACE):
        along = np.einsum("kj,kj->k", axes[face], directions) / np.abs(length)
        at = np.clip((along * 0.5 + 0.5) * size - 0.5, 0.0, size - 1.0)
        low.append(np.minimum(at.astype(np.intp), size - 2))
        part.append((at - low[-1])[:, None])
    (row, column), (down, right) = low, part
    upper = faces[face, row, column] * (1 - right) + faces[face, row, column + 1] * right
    lower = faces[face, row + 1, column] * (1 - right) + faces[face, row + 1, column + 1] * right
    return upper * (1 - down) + lower * down


def cubemap_solid_angles(size: int) -> Float64Array:
    """Solid angles (size, size) in sr of the texels of one face; six faces make 4 pi."""
    axis = (np.arange(size) + 0.5) / size * 2.0 - 1.0
    square = axis[:, None] ** 2 + axis[None, :] ** 2
    return 4.0 / (size**2 * (1.0 + square) ** 1.5)


def luminance(colour: FloatArray) -> Float64Array:
    """Luminance (...) of linear sRGB (..., 3)."""
    return np.asarray(colour, dtype=np.float64) @ LUMINANCE_WEIGHTS


def horizontal_illuminance(cubemap: FloatArray) -> float:
    """Illuminance in lx of level ground under a cubemap (6, n, n, 3) of cd/m²."""
    size = cubemap.shape[1]
    cosine = np.maximum(cubemap_directions(size)[..., 2], 0.0)
    return float(np.sum(luminance(cubemap) * cosine * cubemap_solid_angles(size)))


def colour_from_chromaticity(chromaticity: Float64Array) -> Float64Array:
    """Convert CIE 1931 chromaticities (..., 2) to linear sRGB (..., 3) of luminance 1."""
    x, y = chromaticity[..., 0], chromaticity[..., 1]
    xyz = np.stack([x / y, np.ones_like(x), (1.0 - x - y) / y], axis=-1)
    rgb = xyz @ _RGB_FROM_XYZ.T
    return rgb / luminance(rgb)[..., None]


BLACK_BODY_TEMPERATURES_K = np.array([2700.0, 3200.0, 4000.0, 5500.0, 6500.0, 10_000.0])
BLACK_BODY_COLOURS = np.array(
    [
        [1.93, 0.81, 0.19],
        HALOGEN_COLOUR,
        LED_COLOUR,
        [1.10, 0.99, 0.82],
        [1.0, 1.0, 1.0],
        [0.82, 1.01, 1.40],
    ]
)
"""Linear sRGB at luminance 1 by temperature."""


def black_body_colour(temperature_k: float) -> Float64Array:
    """Compute the linear sRGB colour (3,) of a black body, at luminance 1."""
    mired = 1e6 / BLACK_BODY_TEMPERATURES_K[::-1]
    channels = [
        np.interp(1e6 / temperature_k, mired, column) for column in BLACK_BODY_COLOURS[::-1].T
    ]
    colour = np.array(channels)
    return colour / float(luminance(colour))
