"""Signals of a vehicle's bus: wheel speeds, steering, yaw rate, brake and indicators.

Wheels roll without slip and steer by Ackermann: the front wheels roll along the paths of their
hubs, the rear wheels straight on. As in the traffic's kinematics, the steering angle is of the
kinematic bicycle, `atan(wheelbase * curvature of the rear axle's path)` (Rajamani, Vehicle Dynamics
and Control, 2nd edition, 2.2).
"""

import math
from dataclasses import replace

import numpy as np
from advercity_dsl.can_bus import CanBus
from advercity_dsl.units import M_S_PER_KM_H

from advercity.frames import WHEELBASE_FRACTION, ActorState, Lamp
from advercity.geometry.arrays import Float64Array
from advercity.randomness import create_generator
from advercity.sensors.measurements import CanSample, Indicator
from advercity.sensors.sample_times import list_sample_times

TRACK_FRACTION = 0.86
"""Distance of the wheels of an axle over a vehicle's width: 1.53 of 1.79 m of a VW Golf."""
_INDICATORS = {
    Lamp(0): Indicator.OFF,
    Lamp.LEFT: Indicator.LEFT,
    Lamp.RIGHT: Indicator.RIGHT,
    Lamp.LEFT | Lamp.RIGHT: Indicator.HAZARD,
}


def sample_can_bus(
    bus: CanBus,
    states: tuple[ActorState, ActorState],
    tick_s: float,
    *,
    key: tuple[int | str, ...],
    frame: int,
) -> CanSample | None:
    """Sample the signals between two successive ticks, including the second.

    Signals are interpolated linearly between the ticks; lamps are taken from the second.

    Args:
        bus: Rate, steps and errors.
        states: The vehicle at the previous tick and at this one.
        tick_s: Time between them.
        key: Key of the vehicle's errors, the same for all frames.
        frame: Number of the frame from 0.

    Returns:
        The last of the samples with those before it, or None if there is none.
    """
    fractions = list_sample_times(bus, tick_s, frame, key=(*key, "can")).fractions
    if not len(fractions):
        return None
    last, now = states
    part = fractions[:, None]
    motion = (1.0 - part) * _describe_motion(last) + part * _describe_motion(now)
    steering_rad = np.interp(fractions, [0.0, 1.0], [last.steering_rad, now.steering_rad])
    drawn = create_generator(*key, "can").standard_normal(6)
    wheels = _compute_wheel_speeds(motion, now) / (1.0 + bus.tyre_error * drawn[:4])
    wheels = _round_to_step(wheels, bus.wheel_speed_step_km_h * M_S_PER_KM_H)
    wheel_deg = np.degrees(steering_rad) * bus.steering_ratio + bus.steering_offset_deg * drawn[4]
    yaw_deg_s = np.degrees(motion[:, 2]) + bus.yaw_rate_offset_deg_s * drawn[5]
    samples = [
        CanSample(
            wheel_speeds_m_s=wheels[at],
            # As on real buses, from the rear wheels, which are not steered.
            speed_m_s=float(wheels[at, 2:].mean()),
            steering_wheel_rad=math.radians(
                float(_round_to_step(wheel_deg[at], bus.steering_step_deg))
            ),
            yaw_rate_rad_s=math.radians(
                float(_round_to_step(yaw_deg_s[at], bus.yaw_rate_step_deg_s))
            ),
            is_braking=Lamp.BRAKE in now.lamps,
            indicator=_INDICATORS[now.lamps & (Lamp.LEFT | Lamp.RIGHT)],
            time_s=float(fractions[at] - 1.0) * tick_s,
        )
        for at in range(len(fractions))
    ]
    return replace(samples[-1], earlier=tuple(samples[:-1]))


def _describe_motion(state: ActorState) -> Float64Array:
    """Describe a body's motion as speeds (3,) ahead, to the left, and turning to the left."""
    ahead, left, _ = state.world_from_body[:3, :3].T @ state.motion.velocity
    return np.array([ahead, left, state.motion.angular_rate[2]])


def _compute_wheel_speeds(motion: Float64Array, state: ActorState) -> Float64Array:
    """Compute speeds (n, 4) of wheels: front left, front right, rear left, rear right."""
    length_m, width_m, _ = state.actor.size
    half_base_m, half_track_m = WHEELBASE_FRACTION * length_m / 2, TRACK_FRACTION * width_m / 2
    ahead, left, turn = motion.T
    sides = np.array([half_track_m, -half_track_m])
    along = ahead[:, None] - turn[:, None] * sides
    across = (left + turn * half_base_m)[:, None]
    return np.hstack([np.copysign(np.hypot(along, across), along), along])


def _round_to_step(values: Float64Array, step: float) -> Float64Array:
    return np.round(values / step) * step if step > 0.0 else values
