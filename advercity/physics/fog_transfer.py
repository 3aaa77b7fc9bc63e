"""Light in layers of scattering air over a plane, by doubling and adding (van de Hulst 1980).

Radiances are series in the cosine of the azimuth from the sun, one term after the other along the
first axis; directions are `Streams`, as many down as up.

Daylight in a bank of fog over the ground: scattered many times, and sent back up by the ground.

Droplets send half of what they scatter on within a few degrees. Light that has only met those is
followed as if it had not met them (delta scaling; Joseph, Wiscombe and Weinman 1976), and spread
over an aureole where one looks towards the sun.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from advercity.geometry.arrays import Float64Array
from advercity.physics.scattering import DropletPhaseLobes, PhaseFunction, henyey_greenstein

NUM_STREAMS, NUM_AZIMUTH_TERMS = 24, 12
"""Directions between level and vertical, and terms in azimuth beyond the mean."""
NUM_AZIMUTHS = 128
"""Of the quadrature around the vertical."""
NUM_DOUBLINGS = 20
"""From a layer so thin that light is scattered in it once."""


@dataclass(frozen=True, eq=False)
class Streams:
    """Directions, and how air scatters light from one into another.

    Attributes:
        cosine: (n,) to the vertical, the last one the sun's.
        weight: (n,) of the integral over cosines, none for the sun.
        forward_kernel: (terms, n, n) from the last axis into the one before, both up or both down.
        backward_kernel: The same from down to up.
    """

    cosine: Float64Array
    weight: Float64Array
    forward_kernel: Float64Array
    backward_kernel: Float64Array

    @classmethod
    def from_sun_cosine(cls, cosine: float, phase: PhaseFunction) -> "Streams":
        """Gaussian directions and the sun's, in air that scatters by a smooth phase function."""
        node, weight = np.polynomial.legendre.leggauss(NUM_STREAMS)
        cosines = np.append((node + 1.0) / 2.0, cosine)
        weights = np.append(weight / 2.0, 0.0)
        onward, back = (
            _expand_phase_function(cosines, sign * cosines, phase) for sign in (1.0, -1.0)
        )
        kept = weights @ (onward[0] + back[0])
        return cls(cosines, weights, onward / kept, back / kept)

    def illuminance(self, radiance: Float64Array) -> float:
        """Of a level plane under (terms, n)."""
        return float(2.0 * np.pi * (self.weight * self.cosine) @ radiance[0])

    def scatter(
        self, same_direction: Float64Array, opposite_direction: Float64Array
    ) -> Float64Array:
        """What air scatters (terms, n), by radiances the same way and the other."""
        return np.einsum(
            "mij,j,mj->mi", self.forward_kernel, self.weight, same_direction
        ) + np.einsum("mij,j,mj->mi", self.backward_kernel, self.weight, opposite_direction)

    def to_azimuth_series(self, radiance: Float64Array) -> Float64Array:
        """Terms (terms, n) of radiances (n, AZIMUTHS), at `azimuths`."""
        terms = (
            radiance
            @ np.cos(np.outer(quadrature_azimuths(), np.arange(NUM_AZIMUTH_TERMS + 1)))
            / NUM_AZIMUTHS
        )
        return np.where(np.arange(NUM_AZIMUTH_TERMS + 1) > 0, 2.0, 1.0)[:, None] * terms.T


@dataclass(frozen=True, eq=False)
class ScatteringLayer:
    """What a layer does to light: the same from above and from below.

    Attributes:
        reflectance: (terms, n, n) from the last axis into the one before, before weights.
        diffuse_transmittance: The same for what goes through and is scattered.
        direct_transmittance: (n,) what goes through and is not.
    """

    reflectance: Float64Array
    diffuse_transmittance: Float64Array
    direct_transmittance: Float64Array

    @classmethod
    def from_optical_depth(cls, depth: float, streams: Streams) -> "ScatteringLayer":
        """A layer of an optical depth that absorbs nothing."""
        thin = depth / 2.0**NUM_DOUBLINGS
        layer = cls(
            streams.backward_kernel * (thin / streams.cosine)[:, None],
            streams.forward_kernel * (thin / streams.cosine)[:, None],
            np.exp(-thin / streams.cosine),
        )
        for _ in range(NUM_DOUBLINGS):
            layer = layer.double(streams.weight)
        return layer

    def double(self, weight: Float64Array) -> "ScatteringLayer":
        """Two of it, one upon the other."""
        straight = self.direct_transmittance
        again, through = self.reflectance * weight, self.diffuse_transmittance * weight
        forth = np.linalg.inv(np.eye(len(weight)) - again @ again)
        down = forth @ (self.diffuse_transmittance + again @ (self.reflectance * straight))
        up = self.reflectance * straight + again @ down
        return ScatteringLayer(
            self.reflectance + straight[:, None] * up + through @ up,
            straight[:, None] * down + self.diffuse_transmittance * straight + through @ down,
            straight**2,
        )

    def transmit(self, radiance: Float64Array, weight: Float64Array) -> Float64Array:
        """What of (terms, n) comes out on the other side."""
        return self.direct_transmittance * radiance + _apply_matrix(
            self.diffuse_transmittance * weight, radiance
        )

    def reflect(self, radiance: Float64Array, weight: Float64Array) -> Float64Array:
        """What of (terms, n) comes back."""
        return _apply_matrix(self.reflectance * weight, radiance)

    def scatter_sunlight(self, lux: float) -> tuple[Float64Array, Float64Array]:
        """What it sends back and on, scattered, (terms, n) of a sun of so many lux."""
        terms = len(self.reflectance)
        share = lux / np.pi * np.where(np.arange(terms) > 0, 1.0, 0.5)[:, None]
        return share * self.reflectance[:, :, -1], share * self.diffuse_transmittance[:, :, -1]


def quadrature_azimuths() -> Float64Array:
    """Angles (AZIMUTHS,) from the sun at which `Streams.series` wants radiances."""
    return (np.arange(NUM_AZIMUTHS) + 0.5) / NUM_AZIMUTHS * np.pi


def _apply_matrix(matrix: Float64Array, radiance: Float64Array) -> Float64Array:
    return (matrix @ radiance[..., None])[..., 0]


def _expand_phase_function(
    towards: Float64Array, coming: Float64Array, phase: PhaseFunction
) -> Float64Array:
    """Terms (terms, n, n) of a phase function, times two pi."""
    turn = np.cos(quadrature_azimuths())
    level = np.sqrt(1.0 - towards**2)[:, None, None] * np.sqrt(1.0 - coming**2)[:, None]
    turned = phase(towards[:, None, None] * coming[:, None] + level * turn)
    wave = np.cos(np.outer(np.arange(NUM_AZIMUTH_TERMS + 1), quadrature_azimuths())) * (
        2.0 * np.pi / NUM_AZIMUTHS
    )
    return np.einsum("ijf,mf->mij", turned, wave)


EYE_HEIGHT_M = 2.0
"""Above the ground, where the light is looked at."""
MIN_SUN_SINE = 0.02
"""Sine of the elevation below which a layer that is even is not what the sun shines through."""
MAX_AUREOLE_ORDERS = 32
"""How often, at most, light of the aureole has been turned a little."""
SHADED_AUREOLE_COSINE = math.cos(math.radians(10.0))
"""Nearer to the sun, what stands before the sky takes the sun from the air before it."""
MIN_AIRLIGHT_GROWTH, MAX_AIRLIGHT_GROWTH = -0.9, 10.0
NEGLIGIBLE_TERM, CONVERGENCE_TOLERANCE = 1e-3, 1e-7


@dataclass(frozen=True)
class FogBank:
    """An even layer of fog on level ground.

    Attributes:
        extinction: 1/m.
        depth_m: From the ground to its top.
        droplet_um: Diameter of the droplets.
        ground_albedo: Of what lies under it.
    """

    extinction: float
    depth_m: float
    droplet_um: float
    ground_albedo: float


@dataclass(frozen=True, eq=False)
class FogRadiance:
    """The light in a fog bank, near the ground; luminances in cd/m².

    Attributes:
        sun_lx: What is left of the sun, on a surface that faces it.
    """

    sun_lx: float
    _sun: Float64Array
    _forward_lx: float
    _orders: Float64Array
    _lobes: DropletPhaseLobes
    _elevations: Float64Array
    _seen: Float64Array
    _scattered: Float64Array
    _rise: Float64Array

    def sky_luminance(self, directions: Float64Array) -> Float64Array:
        """Luminances (...) seen in directions (..., 3) where nothing but ground is in the way."""
        return self._evaluate_series(self._seen, directions) + self._aureole_luminance(
            directions @ self._sun, 0
        )

    def airlight_luminance(self, directions: Float64Array) -> Float64Array:
        """Luminances (...) of air near the eye, for the light that it takes away."""
        cosine = directions @ self._sun
        near_sun = (
            self._aureole_luminance(np.minimum(cosine, SHADED_AUREOLE_COSINE), 1)
            * self._lobes.narrow_fraction
        )
        wide = self._forward_lx * self._lobes.wide_phase(cosine) * self._lobes.wide_fraction
        return self._evaluate_series(self._scattered, directions) + near_sun + wide

    def airlight_growth(self, directions: Float64Array) -> Float64Array:
        """By what share (...) airlight grows along endless rays; none looks up for ever."""
        return np.interp(_elevation_rad(directions), self._elevations, self._rise)

    def _evaluate_series(self, series: Float64Array, directions: Float64Array) -> Float64Array:
        """Sum (...) of a series (terms, elevations) in the azimuth from the sun."""
        level = np.hypot(directions[..., 0], directions[..., 1])
        aside = math.hypot(self._sun[0], self._sun[1])
        along = directions[..., :2] @ self._sun[:2]
        turn = np.divide(along, level * aside, out=np.ones_like(along), where=level * aside > 0.0)
        turn = np.arccos(np.clip(turn, -1.0, 1.0))
        elevation = _elevation_rad(directions)
        mean = np.interp(elevation, self._elevations, series[0])
        for term in range(1, len(series)):
            if np.abs(series[term]).max() > NEGLIGIBLE_TERM * series[0].max():
                wave = np.interp(elevation, self._elevations, series[term])
                mean += wave * np.cos(term * turn)
        return mean

    def _aureole_luminance(self, cosine: Float64Array, more: int) -> Float64Array:
        """Luminances (...) of sunlight that has been turned a little, and `more` times again."""
        total = np.zeros_like(cosine)
        if self._forward_lx > 0.0:
            for order, share in enumerate(self._orders):
                if share > 1e-6 and order + more > 0:
                    g = self._lobes.narrow_g ** (order + more)
                    total += self._forward_lx * share * henyey_greenstein(cosine, g)
        return total


def compute_fog_radiance(
    bank: FogBank,
    *,
    sun: Float64Array,
    direct_lx: float,
    sky: Callable[[Float64Array], Float64Array],
) -> FogRadiance:
    """The light in a bank under the sun in direction (3,) and a sky.

    Args:
        bank: Absorbs nothing.
        sun: Unit vector towards it.
        direct_lx: Of the sun above the bank, on a surface that faces it.
        sky: Luminances (...) in cd/m² above it, by unit vectors (..., 3) that look up.
    """
    lobes = DropletPhaseLobes.from_diameter_um(bank.droplet_um)
    streams = Streams.from_sun_cosine(max(MIN_SUN_SINE, float(sun[2])), lobes.wide_phase)
    eye_m = min(EYE_HEIGHT_M, bank.depth_m)
    depth, above_eye = bank.extinction * bank.depth_m, bank.extinction * (bank.depth_m - eye_m)
    at_top = streams.to_azimuth_series(sky(_directions_around_sun(streams.cosine, sun)))
    above = ScatteringLayer.from_optical_depth(lobes.wide_fraction * above_eye, streams)
    below = ScatteringLayer.from_optical_depth(
        lobes.wide_fraction * bank.extinction * eye_m, streams
    )
    at_eye_lx = direct_lx * above.direct_transmittance[-1]
    down, up = _solve_interreflection(bank, streams, (above, below), at_top, direct_lx)

    scattered = np.concatenate(
        [
            streams.scatter(same_direction=down, opposite_direction=up),
            streams.scatter(same_direction=up, opposite_direction=down),
        ],
        1,
    )
    seen = np.concatenate([down, up], 1)
    near = lobes.wide_fraction * scattered + lobes.narrow_fraction * seen
    by_sun = at_eye_lx / (2.0 * math.pi) * lobes.wide_fraction * streams.forward_kernel[0, :, -1]
    far = down[0] - at_top[0] * np.exp(-above_eye / streams.cosine)
    rise = _airlight_growth(near[0, : len(by_sun)] + by_sun, far, above_eye / streams.cosine)

    elevation = np.arcsin(np.concatenate([streams.cosine, -streams.cosine]))
    order = np.argsort(elevation)
    turned_little = lobes.narrow_fraction * depth / streams.cosine[-1]
    return FogRadiance(
        sun_lx=direct_lx * math.exp(-depth / streams.cosine[-1]),
        _sun=sun,
        _forward_lx=at_eye_lx * below.direct_transmittance[-1],
        _orders=_poisson_probabilities(turned_little),
        _lobes=lobes,
        _elevations=np.concatenate([[-math.pi / 2.0], elevation[order], [math.pi / 2.0]]),
        _seen=_append_poles(seen[:, order]),
        _scattered=_append_poles(near[:, order]),
        _rise=_append_poles(np.concatenate([rise, np.zeros_like(rise)])[order][None])[0],
    )


def _solve_interreflection(
    bank: FogBank,
    streams: Streams,
    layers: tuple[ScatteringLayer, ScatteringLayer],
    at_top: Float64Array,
    direct_lx: float,
) -> tuple[Float64Array, Float64Array]:
    """What comes down to the eye and up to it, (terms, n) each, between two layers and ground."""
    above, below = layers
    weight = streams.weight
    first = above.transmit(at_top, weight) + above.scatter_sunlight(direct_lx)[1]
    at_eye_lx = direct_lx * above.direct_transmittance[-1]
    back_of_sun, on_of_sun = below.scatter_sunlight(at_eye_lx)
    sun_on_ground_lx = at_eye_lx * below.direct_transmittance[-1] * streams.cosine[-1]
    down, ground = first, np.zeros_like(at_top)
    while True:
        at_ground = below.transmit(down, weight) + on_of_sun + below.reflect(ground, weight)
        lux = streams.illuminance(at_ground) + sun_on_ground_lx
        ground[0] = bank.ground_albedo * lux / math.pi
        up = below.reflect(down, weight) + back_of_sun + below.transmit(ground, weight)
        before, down = down, first + above.reflect(up, weight)
        if np.abs(down - before).max() <= CONVERGENCE_TOLERANCE * down.max():
            return down, up


def _airlight_growth(near: Float64Array, far: Float64Array, depth: Float64Array) -> Float64Array:
    """By what share (n,) airlight grows along rays that end at an optical depth, seen as `far`.

    The light is taken to grow evenly with height.
    """
    left = np.exp(-depth)
    grown = 1.0 - left * (1.0 + depth)
    more, whole = far - near * (1.0 - left), near * grown
    share = np.divide(more, whole, out=np.zeros_like(near), where=whole > 0.0)
    return np.clip(share, MIN_AIRLIGHT_GROWTH, MAX_AIRLIGHT_GROWTH)


def _append_poles(series: Float64Array) -> Float64Array:
    """A series (terms, n) from nadir to zenith, where azimuths no longer differ."""
    ends = np.zeros_like(series[:, :2])
    ends[0] = series[0, 0], series[0, -1]
    return np.concatenate([ends[:, :1], series, ends[:, 1:]], axis=1)


def _elevation_rad(directions: Float64Array) -> Float64Array:
    return np.arcsin(np.clip(directions[..., 2], -1.0, 1.0))


def _directions_around_sun(cosine: Float64Array, sun: Float64Array) -> Float64Array:
    """Directions (n, AZIMUTHS, 3) that look up, at angles from the sun's azimuth."""
    turn = quadrature_azimuths() + math.atan2(sun[1], sun[0])
    level = np.sqrt(1.0 - cosine**2)[:, None]
    up = np.broadcast_to(cosine[:, None], (len(cosine), len(turn)))
    return np.stack([level * np.cos(turn), level * np.sin(turn), up], axis=-1)


def _poisson_probabilities(mean: float) -> Float64Array:
    """Chances (ORDERS,) of being turned none, one, two ... times."""
    order = np.arange(MAX_AUREOLE_ORDERS)
    logarithm = np.cumsum(np.log(np.maximum(order, 1)))
    return np.exp(order * math.log(max(mean, 1e-12)) - mean - logarithm)
