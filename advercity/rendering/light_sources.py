"""Light sources of a scene at night: lamps of streets, signals and vehicles."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from advercity_dsl import ActorClass
from numpy.typing import NDArray

from advercity.frames import ActorState, Frame, Lamp, Signal
from advercity.geometry.poses import transform_points
from advercity.physics.lamp_beams import LEFT_HAND_PATTERNS, LampPattern, LightSource
from advercity.physics.photometry import (
    HALOGEN_COLOUR,
    LED_COLOUR,
    LED_HEADLAMP_COLOUR,
    Colour,
)
from advercity.signal_heads import SIGNAL_HEADS, GovernedTraffic
from advercity.world import SignalLamp, StreetLamp, World

RED_LAMP_COLOUR: Colour = (4.60, 0.03, 0.0)
AMBER_LAMP_COLOUR: Colour = (2.30, 0.72, 0.0)
SIGNAL_COLOURS: dict[Signal, Colour] = {
    Signal.RED: RED_LAMP_COLOUR,
    Signal.YELLOW: AMBER_LAMP_COLOUR,
    Signal.GREEN: (0.0, 1.30, 0.90),
}
LOW_BEAM_CD: dict[ActorClass, float] = {
    "car": 40e3,
    "van": 40e3,
    "truck": 40e3,
    "motorcycle": 20e3,
    "bicycle": 1e3,
}
"""Peak intensity of a vehicle's low beams of halogen bulbs together (UN R112 class B, R113)."""
LED_LOW_BEAM_RATIO = 1.15
"""Peak of a low beam of LEDs, relative to one of a halogen bulb; so it has 1.2 times its light."""
HIGH_BEAM_CD: dict[ActorClass, float] = {
    "car": 100e3,
    "van": 100e3,
    "truck": 100e3,
    "motorcycle": 50e3,
}
"""Peak intensity of a vehicle's high beams together, which are lit beside the low beams (UN R112
class B: 40.5 to 215 kcd each)."""
BRAKE_CD, TAIL_CD = 300.0, 16.0
SIGNAL_CD: dict[GovernedTraffic, float] = {"vehicles": 400.0, "pedestrians": 48.0}
"""Intensity of a signal; a pedestrian's has the same luminance, on the area of a figure."""
REAR_FOG_CD, FRONT_INDICATOR_CD, REAR_INDICATOR_CD = 200.0, 300.0, 200.0
"""Rear fog lamps together, indicators each (UN R148 allows 150-300, 175-1000 and 50-500)."""
FRONT_FOG_CD = 8e3
"""Peak of both front fog lamps together; an engineering value, a fifth of the low beams."""
FOG_LAMP_HEIGHT_M, FOG_LAMP_TILT_RAD = 0.40, np.radians(1.5)
"""Mounting height and downward tilt of front fog lamps: their light ends below the low beams'."""
REAR_LAMP_OFFSET_FRACTION, LOW_BEAM_OFFSET_FRACTION = 0.4, 0.35
"""Lateral offset of rear lamps and indicators, and of low beams, in widths of the vehicle."""
TWO_WHEELER_CLASSES: tuple[ActorClass, ...] = ("bicycle", "motorcycle")
LAMP_HEIGHT_M, LAMP_BODY_CLEARANCE_M = 0.65, 0.1
"""The clearance keeps a lamp's own body out of its light."""
MAX_OCCLUDER_GAP_M, LIT_BEHIND_OCCLUDER_M = 12.0, 6.0
"""Gap within which a vehicle ahead hides a beam, and length of the light beyond its rear."""
SIGNAL_LENS_OFFSET_M = 0.02
"""Forward offset of the lens in the mesh of a signal."""


def list_light_sources(world: World, frame: Frame) -> list[LightSource]:
    """List all lamps lit in a frame at night."""
    beams = zip(frame.states, unobstructed_distance_m(frame.states), strict=True)
    towing = {state.actor.towed_by for state in frame.states}
    lamps = [
        *(_build_street_light(lamp) for lamp in world.street_lamps),
        *(
            _build_signal_light(
                lamp, frame.signals[lamp.id], frame.signal_light_ratios.get(lamp.id, 1.0)
            )
            for lamp in world.signal_lamps
            if frame.signals[lamp.id] in SIGNAL_HEADS[lamp.governs].lens_heights_m
        ),
        *(
            lamp
            for state, free_m in beams
            for lamp in _iterate_vehicle_lights(
                state, free_m, has_rear=state.actor.id not in towing
            )
        ),
    ]
    # Flickering lamps may be dark throughout an exposure.
    lit = [lamp for lamp in lamps if lamp.intensity_cd > 0.0]
    return [_mirror_pattern(lamp) for lamp in lit] if world.is_left_hand else lit


def _mirror_pattern(lamp: LightSource) -> LightSource:
    """Mirror a lamp for traffic on the left."""
    return replace(lamp, pattern=LEFT_HAND_PATTERNS.get(lamp.pattern, lamp.pattern))


def _build_street_light(lamp: StreetLamp) -> LightSource:
    """Build a Lambertian lamp facing down: its flux is pi times its peak."""
    return LightSource(
        LampPattern.STREET, lamp.position, (0.0, 0.0, -1.0), lamp.flux_lm / np.pi, LED_COLOUR
    )


def _build_signal_light(lamp: SignalLamp, shown: Signal, light_ratio: float) -> LightSource:
    facing = (*lamp.facing, 0.0)
    ahead, _, up = signal_lens_position(lamp.governs, shown)
    position = np.add(lamp.position, np.multiply(facing, ahead + LAMP_BODY_CLEARANCE_M))
    position[2] += up
    cd = light_ratio * SIGNAL_CD[lamp.governs]
    return LightSource(LampPattern.LENS, tuple(position), facing, cd, SIGNAL_COLOURS[shown])


def unobstructed_distance_m(states: Sequence[ActorState]) -> NDArray[np.float64]:
    """Compute the free path (n,) in metres of each actor's beams, before another blocks them."""
    if not states:
        return np.empty(0)
    pose = np.stack([state.world_from_body for state in states])
    length, width, _ = np.array([state.actor.size for state in states]).T
    offset = pose[None, :, :2, 3] - pose[:, None, :2, 3]
    ahead = np.einsum("ijk,ik->ij", offset, pose[:, :2, 0])
    lateral = np.abs(np.einsum("ijk,ik->ij", offset, pose[:, :2, 1]))
    gap = ahead - (length[:, None] + length[None]) / 2.0
    blocks = (ahead > 0.0) & (lateral < width[None] / 2.0) & (gap < MAX_OCCLUDER_GAP_M)
    return np.where(blocks, np.maximum(gap, 0.0) + LIT_BEHIND_OCCLUDER_M, np.inf).min(axis=1)


def _iterate_vehicle_lights(
    state: ActorState, unobstructed_m: float, *, has_rear: bool
) -> Iterator[LightSource]:
    """Iterate over the lamps of a vehicle; a lorry's front lamps are on its tractor unit only."""
    has_front = not state.actor.towed_by
    pose, length = state.world_from_body, state.actor.size[0]
    ahead = pose[:3, 0]
    half_length_m = length / 2.0 + LAMP_BODY_CLEARANCE_M
    rear = transform_points(pose, [-half_length_m, 0.0, LAMP_HEIGHT_M])
    sides = (0.0,) if state.actor.actor_class in TWO_WHEELER_CLASSES else (1.0, -1.0)
    low_beam, ratio, colour = (
        (LampPattern.LED_LOW_BEAM, LED_LOW_BEAM_RATIO, LED_HEADLAMP_COLOUR)
        if state.has_led_headlamps
        else (LampPattern.LOW_BEAM, 1.0, HALOGEN_COLOUR)
    )
    vehicle = state.actor.actor_class
    for lamp, pattern, both_cd in (
        (Lamp.LOW_BEAM, low_beam, ratio * LOW_BEAM_CD.get(vehicle, 0.0)),
        (Lamp.HIGH_BEAM, LampPattern.HIGH_BEAM, HIGH_BEAM_CD.get(vehicle, 0.0)),
    ):
        beam_cd = both_cd / len(sides)
        for left in sides if has_front and lamp in state.lamps and beam_cd > 0.0 else ():
            y = left * LOW_BEAM_OFFSET_FRACTION * state.actor.size[1]
            front = tuple(transform_points(pose, [half_length_m, y, LAMP_HEIGHT_M]))
            yield LightSource(pattern, front, tuple(ahead), beam_cd, colour, unobstructed_m)
    if has_front and Lamp.FOG in state.lamps:
        low = tuple(transform_points(pose, [half_length_m, 0.0, FOG_LAMP_HEIGHT_M]))
        down = np.cos(FOG_LAMP_TILT_RAD) * ahead - np.sin(FOG_LAMP_TILT_RAD) * pose[:3, 2]
        yield LightSource(
            LampPattern.FOG_BEAM, low, tuple(down), FRONT_FOG_CD, HALOGEN_COLOUR, unobstructed_m
        )
    if has_rear and state.lamps & (Lamp.BRAKE | Lamp.LOW_BEAM | Lamp.FOG):
        tail_cd = TAIL_CD * state.tail_light_ratio
        rear_cd = BRAKE_CD if Lamp.BRAKE in state.lamps else tail_cd
        rear_cd += REAR_FOG_CD if Lamp.FOG in state.lamps else 0.0
        rear_cd /= len(sides)
        for left in sides:
            offset = left * REAR_LAMP_OFFSET_FRACTION * state.actor.size[1] * pose[:3, 1]
            position = tuple(rear + offset)
            yield LightSource(LampPattern.LENS, position, tuple(-ahead), rear_cd, RED_LAMP_COLOUR)
    front_end = (half_length_m, ahead, FRONT_INDICATOR_CD)
    rear_end = (-half_length_m, -ahead, REAR_INDICATOR_CD)
    ends = [*([front_end] if has_front else []), *([rear_end] if has_rear else [])]
    yield from _iterate_indicator_lights(state, ends)


def _iterate_indicator_lights(
    state: ActorState, ends: Sequence[tuple[float, NDArray[np.float64], float]]
) -> Iterator[LightSource]:
    """Iterate over the lit indicators of ends of a vehicle: x, direction and intensity of each."""
    pose = state.world_from_body
    for lamp, left in ((Lamp.LEFT, 1.0), (Lamp.RIGHT, -1.0)):
        if lamp in state.lamps:
            y = left * REAR_LAMP_OFFSET_FRACTION * state.actor.size[1]
            for x, facing, cd in ends:
                position = tuple(transform_points(pose, [x, y, LAMP_HEIGHT_M]))
                lens = LampPattern.LENS
                yield LightSource(lens, position, tuple(facing), cd, AMBER_LAMP_COLOUR)


def signal_lens_position(governs: GovernedTraffic, signal: Signal) -> tuple[float, float, float]:
    """Compute the position of a signal's lens in the frame of its `SignalLamp`, metres."""
    return SIGNAL_LENS_OFFSET_M, 0.0, SIGNAL_HEADS[governs].lens_heights_m[signal]
