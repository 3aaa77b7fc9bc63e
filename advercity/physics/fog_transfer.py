"""Daylight in fog and dust over the ground, multiply scattered, by doubling and adding.

Radiances (van de Hulst 1980) are cosine series in the azimuth from the sun, terms along the first
axis, at the directions of `Streams`, as many downward as upward ones.

Droplets deflect half of the light by a few degrees only. The transfer treats that half as
unscattered (delta scaling; Joseph, Wiscombe and Weinman 1976), and adds it afterwards as an aureole
around the sun.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from advercity.geometry.arrays import Float64Array, FloatArray
from advercity.physics.scattering import PhaseFunction, PhaseLobes, henyey_greenstein

NUM_STREAMS, NUM_AZIMUTH_TERMS = 24, 12
"""Directions between horizontal and vertical, and terms in azimuth beyond the mean."""
NUM_AZIMUTHS = 128
"""Nodes of the quadrature in azimuth."""
NUM_DOUBLINGS = 20
"""Doublings from a layer so thin that light scatters in it at most once."""


@dataclass(frozen=True, eq=False)
class Streams:
    """Discrete directions, and the scattering of light between them.

    Attributes:
        cosine: (n,) cosines to the vertical, the last one the sun's.
        weight: (n,) quadrature weights over cosines, 0 for the sun.
        forward_kernel: (terms, n, n) scattering from the last axis into the one before, both
            upward or both downward.
        backward_kernel: (terms, n, n) scattering from downward to upward directions.
    """

    cosine: Float64Array
    weight: Float64Array
    forward_kernel: Float64Array
    backward_kernel: Float64Array

    @classmethod
    def from_sun_cosine(
        cls, cosine: float, phase: PhaseFunction, *, scattered_fraction: float = 1.0
    ) -> "Streams":
        """Build Gaussian directions and the sun's, for a smooth phase function.

        The remaining fraction is absorbed.
        """
        node, weight = np.polynomial.legendre.leggauss(NUM_STREAMS)
        cosines = np.append((node + 1.0) / 2.0, cosine)
        weights = np.append(weight / 2.0, 0.0)
        forward, backward = (
            _expand_phase_function(cosines, sign * cosines, phase) for sign in (1.0, -1.0)
        )
        # Quadrature errors would otherwise create or absorb light.
        kept = weights @ (forward[0] + backward[0]) / scattered_fraction
        return cls(cosines, weights, forward / kept, backward / kept)

    def illuminance(self, radiance: Float64Array) -> float:
        """Compute the illuminance of a horizontal plane under radiances (terms, n)."""
        return float(2.0 * np.pi * (self.weight * self.cosine) @ radiance[0])

    def scatter(
        self, same_direction: Float64Array, opposite_direction: Float64Array
    ) -> Float64Array:
        """Compute the scattered radiances (terms, n) from radiances in both directions."""
        onward = np.einsum("mij,j,mj->mi", self.forward_kernel, self.weight, same_direction)
        return onward + np.einsum(
            "mij,j,mj->mi", self.backward_kernel, self.weight, opposite_direction
        )

    def to_azimuth_series(self, radiance: Float64Array) -> Float64Array:
        """Expand radiances (n, azimuths) at `quadrature_azimuths` into a series (terms, n)."""
        terms = np.arange(NUM_AZIMUTH_TERMS + 1)
        wave = np.cos(np.outer(quadrature_azimuths(), terms))
        return np.where(terms > 0, 2.0, 1.0)[:, None] * (radiance @ wave / NUM_AZIMUTHS).T


@dataclass(frozen=True, eq=False)
class ScatteringLayer:
    """Reflection and transmission of a layer, the same from above and from below.

    Attributes:
        reflectance: (terms, n, n) from the last axis into the one before, without weights.
        diffuse_transmittance: (terms, n, n) transmission of scattered light.
        direct_transmittance: (n,) transmission of unscattered light.
    """

    reflectance: Float64Array
    diffuse_transmittance: Float64Array
    direct_transmittance: Float64Array

    @classmethod
    def from_optical_depth(cls, depth: float, streams: Streams) -> "ScatteringLayer":
        """Build a layer of an optical depth."""
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
        """Build the layer of twice the depth (adding method)."""
        direct = self.direct_transmittance
        reflected, transmitted = self.reflectance * weight, self.diffuse_transmittance * weight
        interreflection = np.linalg.inv(np.eye(len(weight)) - reflected @ reflected)
        down = interreflection @ (
            self.diffuse_transmittance + reflected @ (self.reflectance * direct)
        )
        up = self.reflectance * direct + reflected @ down
        return ScatteringLayer(
            self.reflectance + direct[:, None] * up + transmitted @ up,
            direct[:, None] * down + self.diffuse_transmittance * direct + transmitted @ down,
            direct**2,
        )

    def transmit(self, radiance: Float64Array, weight: Float64Array) -> Float64Array:
        """Compute the radiances (terms, n) transmitted through the layer."""
        scattered = _apply_matrix(self.diffuse_transmittance * weight, radiance)
        return self.direct_transmittance * radiance + scattered

    def reflect(self, radiance: Float64Array, weight: Float64Array) -> Float64Array:
        """Compute the radiances (terms, n) reflected by the layer."""
        return _apply_matrix(self.reflectance * weight, radiance)

    def scatter_sunlight(self, lux: float) -> tuple[Float64Array, Float64Array]:
        """Compute the reflected and transmitted sunlight (terms, n), scattered, of a sun in lx."""
        terms = len(self.reflectance)
        scale = lux / np.pi * np.where(np.arange(terms) > 0, 1.0, 0.5)[:, None]
        return scale * self.reflectance[:, :, -1], scale * self.diffuse_transmittance[:, :, -1]


def quadrature_azimuths() -> Float64Array:
    """Compute the azimuths (azimuths,) from the sun for `Streams.to_azimuth_series`."""
    return (np.arange(NUM_AZIMUTHS) + 0.5) / NUM_AZIMUTHS * np.pi


def _apply_matrix(matrix: Float64Array, radiance: Float64Array) -> Float64Array:
    return (matrix @ radiance[..., None])[..., 0]


def _expand_phase_function(
    towards: Float64Array, coming: Float64Array, phase: PhaseFunction
) -> Float64Array:
    """Expand a phase function, times two pi, into terms (terms, n, n)."""
    cosines = np.cos(quadrature_azimuths())
    level = np.sqrt(1.0 - towards**2)[:, None, None] * np.sqrt(1.0 - coming**2)[:, None]
    value = phase(towards[:, None, None] * coming[:, None] + level * cosines)
    wave = np.cos(np.outer(np.arange(NUM_AZIMUTH_TERMS + 1), quadrature_azimuths())) * (
        2.0 * np.pi / NUM_AZIMUTHS
    )
    return np.einsum("ijf,mf->mij", value, wave)


EYE_HEIGHT_M = 2.0
"""Height of evaluation above the ground."""
MIN_SUN_SINE = 0.02
"""Minimum sine of the sun's elevation: below it, a plane layer overestimates the path."""
MAX_AUREOLE_ORDERS = 32
"""Maximum number of small-angle scatterings of light in the aureole."""
SHADED_AUREOLE_COSINE = math.cos(math.radians(10.0))
"""Bound of the aureole in airlight: nearer the sun, an object would shade the air before it."""
MIN_AIRLIGHT_GROWTH, MAX_AIRLIGHT_GROWTH = -0.9, 10.0
NEGLIGIBLE_TERM, CONVERGENCE_TOLERANCE = 1e-3, 1e-7
"""Relative size of omitted terms, and change in the last iteration."""


@dataclass(frozen=True)
class Scatterer:
    """One sort of particles in a bank, in light of one colour.

    Attributes:
        fraction: Fraction of the bank's extinction.
        lobes: Phase function of the particles.
        albedo: Scattered fraction of the extinguished light; the rest is absorbed.
    """

    fraction: float
    lobes: PhaseLobes
    albedo: float = 1.0

    @property
    def wide_fraction(self) -> float:
        """Fraction of the bank's extinction scattered by their wide lobe."""
        return self.fraction * self.albedo * self.lobes.wide_fraction


@dataclass(frozen=True)
class FogBank:
    """A homogeneous layer of floating particles, such as fog and dust, on level ground.

    Attributes:
        extinction_per_m: Extinction coefficient in the visible.
        depth_m: Height of its top above the ground.
        ground_albedo: Albedo of the ground.
        scatterers: The particles.
    """

    extinction_per_m: float
    depth_m: float
    ground_albedo: float
    scatterers: tuple[Scatterer, ...]

    @property
    def narrow_fraction(self) -> float:
        """Fraction of the extinction scattered by narrow lobes."""
        return sum(item.fraction * item.lobes.narrow_fraction for item in self.scatterers)

    @property
    def narrow_g(self) -> float:
        """Mean cosine of the narrowest lobe."""
        return max(item.lobes.narrow_g for item in self.scatterers)

    @property
    def wide_fraction(self) -> float:
        """Fraction of the extinction scattered in any other way."""
        return sum(item.wide_fraction for item in self.scatterers)

    def wide_phase(self, cosine: FloatArray) -> FloatArray:
        """Evaluate the phase function (n,) of the light in `wide_fraction`."""
        first, *others = self.scatterers
        shares = [item.wide_fraction / self.wide_fraction for item in others]
        phase = (1.0 - sum(shares)) * first.lobes.wide_phase(cosine)
        for item, share in zip(others, shares, strict=True):
            phase = phase + share * item.lobes.wide_phase(cosine)
        return phase


@dataclass(frozen=True, eq=False)
class FogRadiance:
    """The light in a fog bank near the ground; luminances in cd/m².

    Attributes:
        sun_lx: Remaining direct normal illuminance by the sun.
    """

    sun_lx: float
    _sun: Float64Array
    _forward_lx: float
    _orders: Float64Array
    _bank: FogBank
    _elevations: Float64Array
    _seen: Float64Array
    _scattered: Float64Array
    _rise: Float64Array

    def sky_luminance(self, directions: Float64Array) -> Float64Array:
        """Evaluate the luminances (...) in directions (..., 3), of fog and ground only."""
        aureole = self._aureole_luminance(directions @ self._sun, 0)
        return self._evaluate_series(self._seen, directions) + aureole

    def airlight_luminance(self, directions: Float64Array) -> Float64Array:
        """Evaluate the airlight (...) near the eye: in-scattered luminance per unit opacity."""
        cosine = directions @ self._sun
        aureole = self._aureole_luminance(np.minimum(cosine, SHADED_AUREOLE_COSINE), 1)
        near_sun = aureole * self._bank.narrow_fraction
        wide = self._forward_lx * self._bank.wide_phase(cosine) * self._bank.wide_fraction
        return self._evaluate_series(self._scattered, directions) + near_sun + wide

    def airlight_growth(self, directions: Float64Array) -> Float64Array:
        """Evaluate the relative growth (...) of airlight along rays to the top of the bank."""
        return np.interp(_elevation_rad(directions), self._elevations, self._rise)

    def _evaluate_series(self, series: Float64Array, directions: Float64Array) -> Float64Array:
        """Sum a series (terms, elevations) in the azimuth from the sun, at directions (..., 3)."""
        level = np.hypot(directions[..., 0], directions[..., 1])
        length = level * math.hypot(self._sun[0], self._sun[1])
        along = directions[..., :2] @ self._sun[:2]
        cosine = np.divide(along, length, out=np.ones_like(along), where=length > 0.0)
        azimuth = np.arccos(np.clip(cosine, -1.0, 1.0))
        elevation = _elevation_rad(directions)
        mean = np.interp(elevation, self._elevations, series[0])
        for term in range(1, len(series)):
            if np.abs(series[term]).max() > NEGLIGIBLE_TERM * series[0].max():
                wave = np.interp(elevation, self._elevations, series[term])
                mean += wave * np.cos(term * azimuth)
        return mean

    def _aureole_luminance(self, cosine: Float64Array, more: int) -> Float64Array:
        """Evaluate the luminances (...) of sunlight scattered by small angles.

        `more` is added to the number of scatterings: 0 for light reaching the eye, 1 for light
        scattered once more by the air in front of it.
        """
        total = np.zeros_like(cosine)
        if self._forward_lx > 0.0:
            for order, probability in enumerate(self._orders):
                if probability > 1e-6 and order + more > 0:
                    g = self._bank.narrow_g ** (order + more)
                    total += self._forward_lx * probability * henyey_greenstein(cosine, g)
        return total


def compute_fog_radiance(
    bank: FogBank,
    *,
    sun: Float64Array,
    direct_lx: float,
    sky: Callable[[Float64Array], Float64Array],
) -> FogRadiance:
    """Compute the light in a bank under a sun and a sky.

    `sun` (3,) is the direction to it, `direct_lx` its direct normal illuminance above the bank;
    `sky` gives luminances (...) in cd/m² along upward unit vectors (..., 3) there.
    """
    turning = 1.0 - bank.narrow_fraction
    streams = Streams.from_sun_cosine(
        max(MIN_SUN_SINE, float(sun[2])),
        bank.wide_phase,
        scattered_fraction=bank.wide_fraction / turning,
    )
    eye_m = min(EYE_HEIGHT_M, bank.depth_m)
    depth = bank.extinction_per_m * bank.depth_m
    above_eye = bank.extinction_per_m * (bank.depth_m - eye_m)
    at_top = streams.to_azimuth_series(sky(_directions_around_sun(streams.cosine, sun)))
    above = ScatteringLayer.from_optical_depth(turning * above_eye, streams)
    below = ScatteringLayer.from_optical_depth(turning * bank.extinction_per_m * eye_m, streams)
    at_eye_lx = direct_lx * above.direct_transmittance[-1]
    down, up = _solve_interreflection(bank, streams, (above, below), at_top, direct_lx)

    scattered_down = streams.scatter(same_direction=down, opposite_direction=up)
    scattered_up = streams.scatter(same_direction=up, opposite_direction=down)
    scattered = np.concatenate([scattered_down, scattered_up], 1)
    seen = np.concatenate([down, up], 1)
    near = turning * scattered + bank.narrow_fraction * seen
    by_sun = at_eye_lx / (2.0 * math.pi) * turning * streams.forward_kernel[0, :, -1]
    far = down[0] - at_top[0] * np.exp(-above_eye / streams.cosine)
    rise = _airlight_growth(near[0, : len(by_sun)] + by_sun, far, above_eye / streams.cosine)

    elevation = np.arcsin(np.concatenate([streams.cosine, -streams.cosine]))
    order = np.argsort(elevation)
    small_angle_depth = bank.narrow_fraction * depth / streams.cosine[-1]
    return FogRadiance(
        sun_lx=direct_lx * math.exp(-depth / streams.cosine[-1]),
        _sun=sun,
        _forward_lx=at_eye_lx * below.direct_transmittance[-1],
        _orders=_poisson_probabilities(small_angle_depth),
        _bank=bank,
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
    """Solve for the downward and upward radiances (terms, n) at the eye, by iteration.

    The eye is between a layer above and a layer below it, over a Lambertian ground.
    """
    above, below = layers
    weight = streams.weight
    first = above.transmit(at_top, weight) + above.scatter_sunlight(direct_lx)[1]
    at_eye_lx = direct_lx * above.direct_transmittance[-1]
    sun_reflected, sun_transmitted = below.scatter_sunlight(at_eye_lx)
    sun_on_ground_lx = at_eye_lx * below.direct_transmittance[-1] * streams.cosine[-1]
    down, ground = first, np.zeros_like(at_top)
    while True:
        at_ground = below.transmit(down, weight) + sun_transmitted + below.reflect(ground, weight)
        lux = streams.illuminance(at_ground) + sun_on_ground_lx
        ground[0] = bank.ground_albedo * lux / math.pi
        up = below.reflect(down, weight) + sun_reflected + below.transmit(ground, weight)
        before, down = down, first + above.reflect(up, weight)
        if np.abs(down - before).max() <= CONVERGENCE_TOLERANCE * down.max():
            return down, up


def _airlight_growth(near: Float64Array, far: Float64Array, depth: Float64Array) -> Float64Array:
    """Compute the relative growth (n,) of airlight along rays of an optical depth.

    With this growth, the rays' in-scattered light, from `near` at the eye, adds up to `far`;
    airlight is assumed to grow linearly with height.
    """
    transmittance = np.exp(-depth)
    weight = 1.0 - transmittance * (1.0 + depth)
    more, whole = far - near * (1.0 - transmittance), near * weight
    growth = np.divide(more, whole, out=np.zeros_like(near), where=whole > 0.0)
    return np.clip(growth, MIN_AIRLIGHT_GROWTH, MAX_AIRLIGHT_GROWTH)


def _append_poles(series: Float64Array) -> Float64Array:
    """Extend a series (terms, n) to nadir and zenith, where azimuths no longer differ."""
    ends = np.zeros_like(series[:, :2])
    ends[0] = series[0, 0], series[0, -1]
    return np.concatenate([ends[:, :1], series, ends[:, 1:]], axis=1)


def _elevation_rad(directions: Float64Array) -> Float64Array:
    return np.arcsin(np.clip(directions[..., 2], -1.0, 1.0))


def _directions_around_sun(cosine: Float64Array, sun: Float64Array) -> Float64Array:
    """Build upward directions (n, azimuths, 3) at azimuths relative to the sun's."""
    azimuth = quadrature_azimuths() + math.atan2(sun[1], sun[0])
    level = np.sqrt(1.0 - cosine**2)[:, None]
    up = np.broadcast_to(cosine[:, None], (len(cosine), len(azimuth)))
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), up], axis=-1)


def _poisson_probabilities(mean: float) -> Float64Array:
    """Compute the probabilities (orders,) of 0, 1, 2, ... scatterings."""
    order = np.arange(MAX_AUREOLE_ORDERS)
    logarithm = np.cumsum(np.log(np.maximum(order, 1)))
    return np.exp(order * math.log(max(mean, 1e-12)) - mean - logarithm)
