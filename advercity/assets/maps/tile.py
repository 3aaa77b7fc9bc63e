"""Makes periodic patterns: noise of a band of wavelengths, pieces, blades, spots.

All are periodic by construction: noise is made of whole waves, pieces and blades continue at the
opposite edge. Lengths are metres, x to the right and y up; row 0 is the upper edge.

Functions whose last bits depend on the processor (powers, sines, sums) are computed in double
precision and rounded, the rest in single precision.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray
from advercity.randomness import create_generator

Labels = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Pieces:
    """A division of the tile into bricks, slabs, boards, stones.

    Attributes:
        label: (n, n) number of the piece of each pixel.
        edge_m: (n, n) distance to the edge of the piece; negative in the joints.
        x, y: (n, n) position in the piece, -1 to 1.
        count: Number of pieces.
    """

    label: Labels
    edge_m: FloatArray
    x: FloatArray
    y: FloatArray
    count: int


@dataclass(frozen=True, eq=False)
class Blades:
    """Strokes strewn over the tile, later ones over earlier ones.

    Attributes:
        label: (n, n) number of the uppermost blade, -1 where there is none.
        along: (n, n) position on it, 0 at its foot to 1 at its tip.
        count: Number of blades.
    """

    label: Labels
    along: FloatArray
    count: int


@dataclass(frozen=True)
class Tile:
    """A square of a surface.

    Attributes:
        name: Keys its random numbers.
        size_m: Length of its sides.
        pixels: Pixels of a side, a power of two.
    """

    name: str
    size_m: float
    pixels: int = 1024

    @property
    def pixel_m(self) -> float:
        """Length of a pixel."""
        return self.size_m / self.pixels

    @property
    def x_m(self) -> FloatArray:
        """(1, n) positions of columns."""
        return ((np.arange(self.pixels, dtype=np.float32) + 0.5) * np.float32(self.pixel_m))[None]

    @property
    def y_m(self) -> FloatArray:
        """(n, 1) positions of rows, upwards from the lower edge."""
        return np.ascontiguousarray(self.x_m.T[::-1])

    def generator(self, key: str) -> np.random.Generator:
        """Create the generator of a random pattern of this tile."""
        return create_generator("material_maps", self.name, key)

    def noise(
        self,
        key: str,
        longest_m: float,
        shortest_m: float = 0.0,
        *,
        slope: float = 1.0,
        stretch: tuple[float, float] = (1.0, 1.0),
    ) -> FloatArray:
        """Make Gaussian noise of a band of wavelengths; mean 0, standard deviation 1.

        Args:
            key: Name of the pattern.
            longest_m: Longest wavelength, at least four pixels.
            shortest_m: Shortest wavelength, at least two pixels.
            slope: Amplitude falls with this power of the frequency: 0 is white, 1 to 2 natural.
            stretch: Factors on wavelengths along x and y.
        """
        n = self.pixels
        low, high = (
            1 / max(wavelength_m, pixels * self.pixel_m)
            for wavelength_m, pixels in ((longest_m, 4), (shortest_m, 2))
        )
        # Numbers of waves across and up the tile, as far as the band extends.
        most_x, most_y = (
            min(n // 2 - 1, int(1.3 * high * self.size_m / factor)) for factor in stretch
        )
        waves_x = np.arange(most_x + 1, dtype=np.float32) * np.float32(stretch[0])
        waves_y = np.arange(-most_y, most_y + 1, dtype=np.float32) * np.float32(stretch[1])
        frequency = np.sqrt(np.square(waves_y)[:, None] + np.square(waves_x))
        frequency /= np.float32(self.size_m)
        amplitude = ease(0.5 * low, low, frequency) * (1 - ease(0.7 * high, 1.3 * high, frequency))
        amplitude /= (np.maximum(frequency, low).astype(float) ** (slope + 1)).astype(np.float32)
        shape = 2, *frequency.shape
        parts = self.generator(key).standard_normal(shape, dtype=np.float32) * amplitude
        spectrum = np.zeros((n, n // 2 + 1), np.complex64)
        rows = np.arange(-most_y, most_y + 1)
        spectrum[rows, : most_x + 1] = parts[0] + 1j * parts[1]
        spectrum[0, 0] = 0
        field = np.fft.irfft2(spectrum)
        return (field / np.float32(field.std(dtype=float))).astype(np.float32)

    def lay(
        self,
        columns: int,
        rows: int,
        joint_m: float,
        *,
        shift: float = 0.0,
        corner_m: float = 0.0,
        wobble_m: FloatArray | float = 0.0,
    ) -> Pieces:
        """Lay pieces in rows.

        Args:
            columns: Pieces in a row.
            rows: Rows; an even number where every other row is shifted.
            joint_m: Width of joints.
            shift: Shift of every other row, in pieces.
            corner_m: Radius of the corners.
            wobble_m: Added to the distance from the edge.
        """
        width, height = self.size_m / columns, self.size_m / rows
        row = np.floor(self.y_m / height)
        across = self.x_m / width + np.float32(shift) * (row % 2)
        column = np.floor(across)
        x, y = 2 * (across - column) - 1, 2 * (self.y_m / height - row) - 1
        label = (row * columns + column % columns).astype(np.int32)
        inner = np.float32(0.5 * width - 0.5 * joint_m - corner_m) - np.abs(x) * np.float32(
            width / 2
        )
        lower = np.float32(0.5 * height - 0.5 * joint_m - corner_m) - np.abs(y) * np.float32(
            height / 2
        )
        outside = compute_length(np.minimum(inner, 0), np.minimum(lower, 0))
        edge = np.maximum(np.minimum(inner, lower), 0) - outside + np.float32(corner_m)
        shape = label.shape
        return Pieces(
            label,
            (edge + wobble_m).astype(np.float32),
            x,
            np.broadcast_to(y, shape),
            rows * columns,
        )

    def pack(self, key: str, columns: int, *, jitter: float = 0.8, rows: int = 0) -> Pieces:
        """Pack irregular pieces: the cells of a jittered grid (Worley 1996).

        Args:
            key: Name of the pattern.
            columns: Pieces across the tile, a power of two.
            jitter: How far centres leave the grid, 0 to 1.
            rows: Pieces up the tile, a power of two; 0 for as many as columns.
        """
        n, rows = self.pixels, rows or columns
        generator = self.generator(key)
        centres = np.float32(0.5) + np.float32(jitter) * (
            generator.random((2, rows, columns), dtype=np.float32) - np.float32(0.5)
        )
        inside_x = (np.arange(n // columns, dtype=np.float32) + 0.5) * columns / n
        inside_y = ((np.arange(n // rows, dtype=np.float32) + 0.5) * rows / n)[:, None, None]
        labels = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
        cell_m = np.float32(self.size_m / columns), np.float32(self.size_m / rows)
        blocks = rows, n // rows, columns, n // columns
        nearest = np.full(blocks, np.inf, np.float32)
        second, label = nearest.copy(), np.zeros(blocks, np.int32)
        for down, right in product((-1, 0, 1), repeat=2):
            moved = np.roll(centres, (-down, -right), (1, 2))[:, :, None, :, None]
            square = np.square((inside_x - (moved[0] + right)) * cell_m[0])
            square = square + np.square((inside_y - (moved[1] + down)) * cell_m[1])
            own = np.roll(labels, (-down, -right), (0, 1))[:, None, :, None]
            np.copyto(label, own, where=square < nearest)
            second = np.minimum(second, np.maximum(nearest, square))
            nearest = np.minimum(nearest, square)
        edge_m = 0.5 * (np.sqrt(second) - np.sqrt(nearest)).reshape(n, n)
        label = label.reshape(n, n)
        row, column = np.divmod(label, columns)
        across, down = (
            _wrap(pixel - (first + centre.ravel()[label]), count)
            for pixel, first, centre, count in (
                (self.x_m / cell_m[0], column, centres[0], columns),
                ((self.size_m - self.y_m) / cell_m[1], row, centres[1], rows),
            )
        )
        return Pieces(label, edge_m, 2 * across, -2 * down, rows * columns)

    def strew(
        self,
        key: str,
        count: int,
        length_m: tuple[float, float],
        *,
        bend: float = 0.3,
        width: int = 1,
    ) -> Blades:
        """Strew blades of random place, direction and length.

        Args:
            key: Name of the pattern.
            count: Number of blades.
            length_m: Least and greatest length.
            bend: Sideways bend of the tip as part of the length.
            width: Width at the foot, pixels.
        """
        u = self.generator(key).random((5, count, 1, 1), dtype=np.float32)
        length = (length_m[0] + (length_m[1] - length_m[0]) * u[0]) / np.float32(self.pixel_m)
        angle = 2 * np.pi * u[1].astype(float)
        cosine, sine = np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)
        along = np.linspace(0, 1, int(1.2 * length_m[1] / self.pixel_m) + 2, dtype=np.float32)
        beside = np.arange(width, dtype=np.float32)[:, None] - np.float32(0.5 * (width - 1))
        ahead = length * along + np.zeros_like(beside)
        aside = length * (2 * u[4] - 1) * np.float32(bend) * along**2 + beside * (1 - along)
        column = u[2] * self.pixels + cosine * ahead - sine * aside
        row = u[3] * self.pixels + sine * ahead + cosine * aside
        last = self.pixels - 1  # a mask of bits: sides are powers of two
        place = (np.floor(row).astype(np.int32) & last) * self.pixels
        place += np.floor(column).astype(np.int32) & last
        point = np.full(self.pixels**2, -1, np.int32)
        # Of several points of one pixel the last one stays: a point of the uppermost blade.
        point[place.ravel()] = np.arange(place.size, dtype=np.int32)
        blade, step = point // (width * len(along)), point % len(along)
        shape = self.pixels, self.pixels
        return Blades(blade.reshape(shape), along[step].reshape(shape), count)

    def scatter(
        self,
        key: str,
        columns: int,
        radius_m: tuple[float, float],
        *,
        present: float,
        stretch: tuple[float, float] = (1.0, 1.0),
    ) -> FloatArray:
        """Scatter round spots, one at most in a cell of a jittered grid; 1 inside them.

        Args:
            key: Name of the pattern.
            columns: Cells across and up the tile, a power of two.
            radius_m: Least and greatest radius.
            present: Fraction of the cells with a spot.
            stretch: Factors on the radius along x and y.
        """
        cells = self.pack(key, columns, jitter=0.9)
        half_m = np.float32(0.5 * self.size_m / columns)
        away_m = half_m * compute_length(cells.x / stretch[0], cells.y / stretch[1])
        away_m *= 1 + np.float32(0.15) * self.noise(f"{key}_edge", 0.02 * self.size_m)
        radius = radius_m[0] + (radius_m[1] - radius_m[0]) * self.draw(f"{key}_size", cells)
        is_there = self.draw(f"{key}_there", cells) < present
        return (1 - ease(0.8, 1.15, away_m / radius)) * is_there

    def draw(self, key: str, pattern: Pieces | Blades) -> FloatArray:
        """Draw a number from 0 to 1 for every piece or blade; (n, n)."""
        values = self.generator(key).random(pattern.count + 1, dtype=np.float32)
        return values[pattern.label]


def _wrap(values: FloatArray, period: int) -> FloatArray:
    """Move values by whole periods to within half a period of 0."""
    return (values - period * np.round(values / period)).astype(np.float32)


def compute_length(x: FloatArray, y: FloatArray) -> FloatArray:
    """Compute the length of vectors (x, y)."""
    return np.sqrt(x * x + y * y)


def ease(low: float, high: float, values: FloatArray) -> FloatArray:
    """Rise smoothly from 0 at `low` to 1 at `high`."""
    t = np.clip((values - np.float32(low)) / np.float32(high - low), 0, 1)
    return t * t * (3 - 2 * t)


def blur(values: FloatArray, passes: int = 1) -> FloatArray:
    """Blur over the neighbouring pixels, again and again."""
    for _ in range(passes):
        for axis in (0, 1):
            values = 0.5 * values + 0.25 * (np.roll(values, 1, axis) + np.roll(values, -1, axis))
    return values
