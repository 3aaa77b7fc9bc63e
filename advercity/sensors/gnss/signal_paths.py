"""Paths from satellites to an antenna: blocked by walls, weakened by foliage, reflected by walls.

Only static obstacles count; vehicles and people are ignored.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.frames import Frame
from advercity.geometry.arrays import Float64Array
from advercity.rendering.raycaster import Raycaster, RayHits, Rays
from advercity.semantics import OPAQUE_TO_RADIO, Semantic

MAX_RANGE_M = 1000.0
"""Range of the search for obstacles."""
FOLIAGE_STEP_M = 0.5
FOLIAGE_DB_M = 1.6
"""Loss in foliage. A tree in leaf has a median of 12 dB at 869 MHz (Vogel and Goldhirsh, IEEE
Trans. Antennas Propag. 34, 1986), 16 dB at 1575 MHz by the root of the frequency; here in 10 m."""
MAX_FOLIAGE_DB = 27.0
"""Largest loss in foliage: 20 dB at 869 MHz, scaled likewise; no receiver tracks through more."""
WALL_PERMITTIVITY = 5.24 + 0.753j
"""Concrete at 1.575 GHz (ITU-R P.2040-3, table 3)."""
WALL_HEIGHT_SD_M = 0.01
"""Roughness of facades; an assumption."""
WAVELENGTH_M = 299_792_458.0 / 1575.42e6
"""Wavelength of GPS L1 and Galileo E1, used for all signals."""
REFLECTING = (Semantic.BUILDING, Semantic.WALL, Semantic.BRIDGE)
_SEARCH_AZIMUTHS = 120
_SEARCH_ELEVATIONS_DEG = (2.0, 15.0, 35.0)
_SEARCH_RANGE_M = 150.0
_NO_ACTORS = Frame(0, 0.0, (), {})


@dataclass(frozen=True, eq=False)
class Reflections:
    """The strongest reflection to an antenna from each of n satellites.

    Attributes:
        amplitude: (n,) relative to the open signal, with the antenna's gain; 0 for none.
        excess_m: (n,) length of its path beyond the straight one.
        normal: (n, 3) normal of the wall.
    """

    amplitude: Float64Array
    excess_m: Float64Array
    normal: Float64Array


class SkyView:
    """The sky seen by an antenna in a world without actors."""

    def __init__(self, raycaster: Raycaster) -> None:
        self._raycaster = raycaster

    def look(
        self, antennas: Float64Array, directions: Float64Array
    ) -> tuple[NDArray[np.bool_], Float64Array]:
        """Look from antennas (n, 3) along directions (n, 3), through foliage and thin things.

        Returns:
            (n,) whether a solid obstacle blocks the path, and (n,) the loss in foliage, in dB.
        """
        loss_db, travelled_m = np.zeros((2, len(directions)))
        blocked = np.zeros(len(directions), np.bool_)
        left = np.arange(len(directions))
        while len(left):
            origins = antennas[left] + travelled_m[left, None] * directions[left]
            hits = self._cast(origins, directions[left])
            met = np.isfinite(hits.range_m)
            solid = met & np.isin(hits.semantic, list(OPAQUE_TO_RADIO))
            blocked[left[solid]] = True
            loss_db[left[met & (hits.semantic == Semantic.VEGETATION)]] += (
                FOLIAGE_STEP_M * FOLIAGE_DB_M
            )
            travelled_m[left[met]] += hits.range_m[met] + FOLIAGE_STEP_M
            left = left[met & ~solid]
            left = left[loss_db[left] < MAX_FOLIAGE_DB]
        return blocked, loss_db

    def find_reflections(
        self, antenna: Float64Array, directions: Float64Array, *, cross_polar_db: float
    ) -> Reflections:
        """Find the strongest reflection by a wall from satellites in directions (n, 3).

        Walls are planes found by rays from the antenna. A ray towards a satellite's mirror image
        must hit the wall, at a point with a free path to the satellite.
        """
        count = len(directions)
        walls, distance_m = self._find_walls(antenna)
        best = Reflections(np.zeros(count), np.zeros(count), np.zeros((count, 3)))
        towards = directions @ walls.T
        satellite, wall = np.nonzero(towards > 0.02)
        if not len(satellite):
            return best
        cosine, normal = towards[satellite, wall], walls[wall]
        mirrored = directions[satellite] - 2.0 * cosine[:, None] * normal
        expected_m = distance_m[wall] / cosine
        hits = self._cast(np.repeat(antenna[None], len(wall), axis=0), mirrored)
        is_wall = np.abs(hits.range_m - expected_m) < 0.5
        is_wall &= (hits.normal * normal).sum(axis=1) > 0.95
        rows = np.flatnonzero(is_wall)
        foot = antenna + (hits.range_m[rows] - 0.05)[:, None] * mirrored[rows]
        blocked, loss_db = self.look(foot, directions[satellite[rows]])
        amplitude = compute_reflection(cosine[rows], cross_polar_db=cross_polar_db)
        amplitude *= 10.0 ** (-loss_db / 20.0)
        for row, strength in zip(rows[~blocked], amplitude[~blocked], strict=True):
            at = satellite[row]
            if strength > best.amplitude[at]:
                best.amplitude[at] = strength
                best.excess_m[at] = 2.0 * distance_m[wall[row]] * cosine[row]
                best.normal[at] = normal[row]
        return best

    def _find_walls(self, antenna: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Find upright planes around an antenna: normals (k, 3) towards it, and distances (k,)."""
        azimuth, elevation = np.meshgrid(
            np.arange(_SEARCH_AZIMUTHS) * (2.0 * np.pi / _SEARCH_AZIMUTHS),
            np.radians(_SEARCH_ELEVATIONS_DEG),
        )
        rays = np.column_stack(
            [
                (np.cos(azimuth) * np.cos(elevation)).ravel(),
                (np.sin(azimuth) * np.cos(elevation)).ravel(),
                np.sin(elevation).ravel(),
            ]
        )
        hits = self._cast(np.repeat(antenna[None], len(rays), axis=0), rays, _SEARCH_RANGE_M)
        normal = hits.normal.astype(np.float64)
        is_wall = np.isfinite(hits.range_m) & np.isin(hits.semantic, REFLECTING)
        is_wall &= np.abs(normal[:, 2]) < 0.1
        normal, rays, range_m = normal[is_wall], rays[is_wall], hits.range_m[is_wall]
        distance_m = -(normal * rays).sum(axis=1) * range_m
        # Rounded, so all rays on one wall give one plane.
        planes = np.column_stack([np.round(normal, 2), np.round(distance_m * 2.0) / 2.0])
        _, first = np.unique(planes, axis=0, return_index=True)
        return normal[first], distance_m[first]

    def _cast(
        self, origins: Float64Array, directions: Float64Array, range_m: float = MAX_RANGE_M
    ) -> RayHits:
        self._raycaster.place(_NO_ACTORS)
        rays = Rays(origins.astype(np.float32), directions.astype(np.float32))
        return self._raycaster.cast(rays, range_m)


def compute_reflection(cosine: Float64Array, *, cross_polar_db: float) -> Float64Array:
    """Compute the received amplitudes (n,) of a wave reflected by a wall.

    Fresnel's coefficients keep one part of a circular polarisation and turn the other, which the
    antenna suppresses; roughness takes a part of both (Ament, Proc. IRE 41, 142, 1953).

    Args:
        cosine: (n,) of the angle of incidence.
        cross_polar_db: Suppression of the turned polarisation by the antenna.
    """
    root = np.sqrt(WALL_PERMITTIVITY - (1.0 - cosine**2))
    across = (cosine - root) / (cosine + root)
    along = (WALL_PERMITTIVITY * cosine - root) / (WALL_PERMITTIVITY * cosine + root)
    kept, turned = np.abs(across + along) / 2.0, np.abs(across - along) / 2.0
    phase_sd = 2.0 * np.pi / WAVELENGTH_M * WALL_HEIGHT_SD_M * cosine
    smooth = np.exp(-2.0 * phase_sd**2)
    return (kept + turned * 10.0 ** (-cross_polar_db / 20.0)) * smooth
