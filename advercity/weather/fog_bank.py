"""Daylight in a bank of fog over the ground: scattered many times, and sent back up by the ground.

Droplets send half of what they scatter on within a few degrees. Light that has only met those is
followed as if it had not met them (delta scaling; Joseph, Wiscombe and Weinman 1976), and spread
over an aureole where one looks towards the sun.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.weather.adding import Layer, Streams, azimuths
from advercity.weather.scattering import DropletLobes, henyey_greenstein

Array = NDArray[np.float64]

EYE_M = 2.0
"""Above the ground, where the light is looked at."""
LOWEST_SUN = 0.02
"""Sine of the elevation below which a layer that is even is not what the sun shines through."""
ORDERS = 32
"""How often, at most, light of the aureole has been turned a little."""
SHADED = math.cos(math.radians(10.0))
"""Nearer to the sun, what stands before the sky takes the sun from the air before it."""
LEAST_RISE, MOST_RISE = -0.9, 10.0
FAINT_TERM, SETTLED = 1e-3, 1e-7


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
class DaylitFog:
    """The light in a fog bank, near the ground; luminances in cd/m².

    Attributes:
        sun_lx: What is left of the sun, on a surface that faces it.
    """

    sun_lx: float
    _sun: Array
    _forward_lx: float
    _orders: Array
    _lobes: DropletLobes
    _elevations: Array
    _seen: Array
    _scattered: Array
    _rise: Array

    def sky(self, directions: Array) -> Array:
        """Luminances (...) seen in directions (..., 3) where nothing but ground is in the way."""
        return self._at(self._seen, directions) + self._aureole(directions @ self._sun, 0)

    def airlight(self, directions: Array) -> Array:
        """Luminances (...) of air near the eye, for the light that it takes away."""
        cosine = directions @ self._sun
        near_sun = self._aureole(np.minimum(cosine, SHADED), 1) * self._lobes.narrow_share
        wide = self._forward_lx * self._lobes.wide(cosine) * self._lobes.wide_share
        return self._at(self._scattered, directions) + near_sun + wide

    def rise(self, directions: Array) -> Array:
        """By what share (...) airlight grows along endless rays; none looks up for ever."""
        return np.interp(_elevation(directions), self._elevations, self._rise)

    def _at(self, series: Array, directions: Array) -> Array:
        """Sum (...) of a series (terms, elevations) in the azimuth from the sun."""
        level = np.hypot(directions[..., 0], directions[..., 1])
        aside = math.hypot(self._sun[0], self._sun[1])
        along = directions[..., :2] @ self._sun[:2]
        turn = np.divide(along, level * aside, out=np.ones_like(along), where=level * aside > 0.0)
        turn = np.arccos(np.clip(turn, -1.0, 1.0))
        elevation = _elevation(directions)
        mean = np.interp(elevation, self._elevations, series[0])
        for term in range(1, len(series)):
            if np.abs(series[term]).max() > FAINT_TERM * series[0].max():
                wave = np.interp(elevation, self._elevations, series[term])
                mean += wave * np.cos(term * turn)
        return mean

    def _aureole(self, cosine: Array, more: int) -> Array:
        """Luminances (...) of sunlight that has been turned a little, and `more` times again."""
        total = np.zeros_like(cosine)
        if self._forward_lx > 0.0:
            for order, share in enumerate(self._orders):
                if share > 1e-6 and order + more > 0:
                    g = self._lobes.narrow_g ** (order + more)
                    total += self._forward_lx * share * henyey_greenstein(cosine, g)
        return total


def daylit(
    bank: FogBank, *, sun: Array, direct_lx: float, sky: Callable[[Array], Array]
) -> DaylitFog:
    """The light in a bank under the sun in direction (3,) and a sky.

    Args:
        bank: Absorbs nothing.
        sun: Unit vector towards it.
        direct_lx: Of the sun above the bank, on a surface that faces it.
        sky: Luminances (...) in cd/m² above it, by unit vectors (..., 3) that look up.
    """
    lobes = DropletLobes.of(bank.droplet_um)
    streams = Streams.with_sun(max(LOWEST_SUN, float(sun[2])), lobes.wide)
    eye_m = min(EYE_M, bank.depth_m)
    depth, above_eye = bank.extinction * bank.depth_m, bank.extinction * (bank.depth_m - eye_m)
    at_top = streams.series(sky(_around(streams.cosine, sun)))
    above = Layer.of_depth(lobes.wide_share * above_eye, streams)
    below = Layer.of_depth(lobes.wide_share * bank.extinction * eye_m, streams)
    at_eye_lx = direct_lx * above.straight[-1]
    down, up = _to_and_fro(bank, streams, (above, below), at_top, direct_lx)

    scattered = np.concatenate(
        [streams.scattered(along=down, against=up), streams.scattered(along=up, against=down)], 1
    )
    seen = np.concatenate([down, up], 1)
    near = lobes.wide_share * scattered + lobes.narrow_share * seen
    by_sun = at_eye_lx / (2.0 * math.pi) * lobes.wide_share * streams.onward[0, :, -1]
    far = down[0] - at_top[0] * np.exp(-above_eye / streams.cosine)
    rise = _rise(near[0, : len(by_sun)] + by_sun, far, above_eye / streams.cosine)

    elevation = np.arcsin(np.concatenate([streams.cosine, -streams.cosine]))
    order = np.argsort(elevation)
    turned_little = lobes.narrow_share * depth / streams.cosine[-1]
    return DaylitFog(
        sun_lx=direct_lx * math.exp(-depth / streams.cosine[-1]),
        _sun=sun,
        _forward_lx=at_eye_lx * below.straight[-1],
        _orders=_poisson(turned_little),
        _lobes=lobes,
        _elevations=np.concatenate([[-math.pi / 2.0], elevation[order], [math.pi / 2.0]]),
        _seen=_with_poles(seen[:, order]),
        _scattered=_with_poles(near[:, order]),
        _rise=_with_poles(np.concatenate([rise, np.zeros_like(rise)])[order][None])[0],
    )


def _to_and_fro(
    bank: FogBank, streams: Streams, layers: tuple[Layer, Layer], at_top: Array, direct_lx: float
) -> tuple[Array, Array]:
    """What comes down to the eye and up to it, (terms, n) each, between two layers and ground."""
    above, below = layers
    weight = streams.weight
    first = above.through(at_top, weight) + above.of_beam(direct_lx)[1]
    at_eye_lx = direct_lx * above.straight[-1]
    back_of_sun, on_of_sun = below.of_beam(at_eye_lx)
    sun_on_ground_lx = at_eye_lx * below.straight[-1] * streams.cosine[-1]
    down, ground = first, np.zeros_like(at_top)
    while True:
        at_ground = below.through(down, weight) + on_of_sun + below.sent_back(ground, weight)
        lux = streams.illuminance(at_ground) + sun_on_ground_lx
        ground[0] = bank.ground_albedo * lux / math.pi
        up = below.sent_back(down, weight) + back_of_sun + below.through(ground, weight)
        before, down = down, first + above.sent_back(up, weight)
        if np.abs(down - before).max() <= SETTLED * down.max():
            return down, up


def _rise(near: Array, far: Array, depth: Array) -> Array:
    """By what share (n,) airlight grows along rays that end at an optical depth, seen as `far`.

    The light is taken to grow evenly with height.
    """
    left = np.exp(-depth)
    grown = 1.0 - left * (1.0 + depth)
    more, whole = far - near * (1.0 - left), near * grown
    share = np.divide(more, whole, out=np.zeros_like(near), where=whole > 0.0)
    return np.clip(share, LEAST_RISE, MOST_RISE)


def _with_poles(series: Array) -> Array:
    """A series (terms, n) from nadir to zenith, where azimuths no longer differ."""
    ends = np.zeros_like(series[:, :2])
    ends[0] = series[0, 0], series[0, -1]
    return np.concatenate([ends[:, :1], series, ends[:, 1:]], axis=1)


def _elevation(directions: Array) -> Array:
    return np.arcsin(np.clip(directions[..., 2], -1.0, 1.0))


def _around(cosine: Array, sun: Array) -> Array:
    """Directions (n, AZIMUTHS, 3) that look up, at angles from the sun's azimuth."""
    turn = azimuths() + math.atan2(sun[1], sun[0])
    level = np.sqrt(1.0 - cosine**2)[:, None]
    up = np.broadcast_to(cosine[:, None], (len(cosine), len(turn)))
    return np.stack([level * np.cos(turn), level * np.sin(turn), up], axis=-1)


def _poisson(mean: float) -> Array:
    """Chances (ORDERS,) of being turned none, one, two ... times."""
    order = np.arange(ORDERS)
    logarithm = np.cumsum(np.log(np.maximum(order, 1)))
    return np.exp(order * math.log(max(mean, 1e-12)) - mean - logarithm)
