"""Noise in a receiver by other radars of the scene.

Chirps without synchronisation cross the receiver's band at random times, so their energy spreads
over all cells: noise with the transmitter's density over its swept band.
"""

import math
from collections.abc import Iterable

import numpy as np

from advercity.geometry.arrays import Float64Array
from advercity.physics.microwaves import WAVELENGTH_M
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.sensors.radar.antenna import compute_gain, compute_noise_w_hz, is_in_view
from advercity.sensors.radar.placement import PlacedRadar

MOUNTING_DEPTH_M = 0.5
"""Distance to a radar within which a surface does not hide it: bumpers are transparent."""


def compute_interference(
    own: PlacedRadar, others: Iterable[PlacedRadar], raycaster: Raycaster
) -> float:
    """Compute the noise of other radars relative to a radar's own; 0 without any.

    Only radars in each other's fields of view with a free path count. The ray caster must be placed
    at the frame, with the own carrier hidden.
    """
    return sum(_compute_one(own, other) for other in others if _is_visible(own, other, raycaster))


def _compute_one(own: PlacedRadar, other: PlacedRadar) -> float:
    there, back = _find_directions(own, other)
    distance_m = np.linalg.norm(other.world_from_radar[:3, 3] - own.world_from_radar[:3, 3])
    gain = compute_gain(own.radar, there) * compute_gain(other.radar, back)
    power_w = 10.0 ** (other.radar.transmit_dbm / 10.0 - 3.0) * float(gain[0])
    received_w = power_w * (WAVELENGTH_M / (4.0 * math.pi * float(distance_m))) ** 2
    density = received_w * other.radar.duty_cycle / (other.radar.bandwidth_mhz * 1e6)
    return density / compute_noise_w_hz(own.radar)


def _is_visible(own: PlacedRadar, other: PlacedRadar, raycaster: Raycaster) -> bool:
    offset = other.world_from_radar[:3, 3] - own.world_from_radar[:3, 3]
    distance_m = float(np.linalg.norm(offset))
    if not distance_m:  # on one mount: neither is in front of the other
        return False
    there, back = _find_directions(own, other)
    if not (is_in_view(own.radar, there)[0] and is_in_view(other.radar, back)[0]):
        return False
    origin, direction = own.world_from_radar[None, :3, 3], (offset / distance_m)[None]
    rays = Rays(origin.astype(np.float32), direction.astype(np.float32))
    hits = raycaster.cast(rays, distance_m)
    is_carrier = other.carrier > 0 and int(hits.instance[0]) == other.carrier
    return is_carrier or float(hits.range_m[0]) > distance_m - MOUNTING_DEPTH_M


def _find_directions(own: PlacedRadar, other: PlacedRadar) -> tuple[Float64Array, Float64Array]:
    """Find the direction (1, 3) of each radar in the frame of the other."""
    offset = other.world_from_radar[:3, 3] - own.world_from_radar[:3, 3]
    unit = offset / np.linalg.norm(offset)
    own_rotation, other_rotation = own.world_from_radar[:3, :3], other.world_from_radar[:3, :3]
    return (unit @ own_rotation)[None], (-unit @ other_rotation)[None]
