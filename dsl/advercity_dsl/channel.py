"""V2X channels: messages of connected vehicles and roadside units, and their arrival.

Without `radio`, every message within `range_m` arrives; with it, the link budget of each pair of
stations decides, along their path in the frame.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import CompactModel, Declaration, InvalidCombination
from advercity_dsl.units import (
    Bytes,
    DecibelMilliwatts,
    Decibels,
    Degrees,
    Flag,
    Fraction,
    MegabitsPerSecond,
    Megahertz,
    Metres,
    MetresPerSecond,
    Number,
    PositiveMetres,
    RangeReason,
    Seconds,
)


def is_multiple(period_s: float, tick_s: float) -> bool:
    """Return whether a period is a whole number of ticks, at least one."""
    ticks = period_s / tick_s
    return round(ticks) >= 1 and abs(ticks - round(ticks)) < 1e-6


PERIOD_REASON = RangeReason("messages are sent once in 10 ms to 10 s", 10)
Period = Annotated[Seconds, Field(ge=0.01, le=10), PERIOD_REASON]
MessageSize = Annotated[Bytes, Field(ge=1, le=100_000_000), RangeReason("at most 100 MB", 1e8)]


class Radio(CompactModel):
    """Radio of all stations, with the path loss of 3GPP TR 37.885 and the rain of ITU-R P.838."""

    environment: Literal["auto", "urban", "highway"] = "auto"
    """Which path loss holds: `auto` is `urban` on urban roads and `highway` on rural ones."""
    frequency_mhz: Annotated[
        Megahertz,
        Field(ge=1000, le=6000),
        RangeReason("the path losses are valid below 6 GHz", 6000),
    ] = 5900
    """Carrier frequency."""
    transmit_dbm: Annotated[DecibelMilliwatts, Field(ge=-20, le=40)] = 23
    """Power at the antenna's connector."""
    antenna_gain_db: Annotated[Decibels, Field(ge=-10, le=20)] = 3
    """Gain of each of the two antennas over an isotropic one, alike in all directions."""
    sensitivity_dbm: Annotated[DecibelMilliwatts, Field(ge=-120, le=-40)] = -82
    """Lowest received power at which a message is decoded."""
    antenna_above_roof_m: Annotated[Metres, Field(ge=0.01, le=3)] = 0.1
    """Height of a vehicle's antenna over the middle of its roof. A roadside unit's antenna is at
    the unit."""
    shadowing: Flag = True
    """Whether the path loss varies from place to place."""
    shadow_decorrelation_m: Annotated[Metres, Field(ge=0.1, le=1000)] = 10
    """Distance driven by both stations together after which shadowing is correlated by 1/e."""


class Latency(CompactModel):
    """Time from the measurement to reception, without the time in the queue and on the air."""

    minimum_s: Annotated[Seconds, Field(ge=0, le=10)] = 0
    """Constant part of the delay."""
    jitter_s: Annotated[Seconds, Field(ge=0, le=10)] = 0
    """Mean of the additional delay, which is exponentially distributed."""


class Loss(CompactModel):
    """Loss of messages from other causes than the link budget, by Gilbert and Elliott.

    Each link between two stations alternates between good times and bursts of loss, both of
    exponentially distributed length.
    """

    rate: Fraction = 0
    """Probability of loss outside bursts."""
    burst_fraction: Annotated[Fraction, Field(le=0.99)] = 0
    """Fraction of the time in bursts."""
    burst_s: Annotated[Seconds, Field(ge=0.01, le=1000)] = 0.5
    """Mean length of a burst."""
    burst_rate: Fraction = 1
    """Probability of loss in a burst."""

    @property
    def total_rate(self) -> float:
        """Fraction of lost messages, over all times."""
        return self.burst_fraction * self.burst_rate + (1 - self.burst_fraction) * self.rate


class PoseError(CompactModel):
    """Errors of transmitted poses: white noise and a slow wander in both.

    The wander is a first-order Gauss-Markov process, as in `gnss` of rigs.
    """

    white_noise_m: Annotated[Metres, Field(ge=0, le=100)] = 0
    """Standard deviation of the white noise of x and of y."""
    wander_m: Annotated[Metres, Field(ge=0, le=100)] = 0
    """Standard deviation of the wander of x and of y."""
    vertical_factor: Annotated[Number, Field(ge=0, le=10)] = 0
    """Factor of vertical errors over horizontal ones."""
    heading_noise_deg: Annotated[Degrees, Field(ge=0, le=90)] = 0
    """Standard deviation of the white noise of the heading."""
    heading_wander_deg: Annotated[Degrees, Field(ge=0, le=90)] = 0
    """Standard deviation of the wander of the heading."""
    wander_time_s: Annotated[Seconds, Field(ge=1, le=3600)] = 120
    """Correlation time of both wanders."""
    roadside_units: Flag = False
    """Whether roadside units err as well; usually they are surveyed."""


class Clock(CompactModel):
    """Clocks of the stations."""

    offset_s: Annotated[Seconds, Field(ge=0, le=10)] = 0
    """Standard deviation of the offsets of the stations' clocks, each constant in a scenario."""


class AwarenessMessage(CompactModel):
    """Cooperative awareness message (ETSI EN 302 637-2): the station itself."""

    generation: Literal["periodic", "dynamic"] = "periodic"
    """`periodic` is one every `period_s`. `dynamic` is the standard's rule: when the heading has
    changed by 4 deg, the position by 4 m or the speed by 0.5 m/s, at most every 0.1 s and at least
    every second."""
    period_s: Period = 0.1
    """Time between messages of `periodic`."""
    size_bytes: MessageSize = 350
    """Size on the air, signature included."""


class PerceptionMessage(CompactModel):
    """Collective perception message (ETSI TR 103 562, TS 103 324): objects sensed by a station.

    It has the station's annotated objects, with drawn errors in place of a detector's and
    tracker's.
    """

    period_s: Period = 0.1
    """Time between messages."""
    min_points: Annotated[int, Field(ge=0, le=1_000_000)] = 5
    """Least LiDAR points on a perceived object."""
    max_objects: Annotated[int, Field(ge=1, le=255)] = 128
    """Most objects in a message; the nearest are sent."""
    range_noise_m: Annotated[Metres, Field(ge=0, le=10)] = 0
    """Standard deviation of an object's distance."""
    bearing_noise_deg: Annotated[Degrees, Field(ge=0, le=10)] = 0
    """Standard deviation of its direction."""
    heading_noise_deg: Annotated[Degrees, Field(ge=0, le=90)] = 0
    """Standard deviation of its heading."""
    speed_noise_m_s: Annotated[MetresPerSecond, Field(ge=0, le=20)] = 0
    """Standard deviation of each component of its velocity."""
    header_bytes: MessageSize = 121
    """Size without sensors and objects."""
    sensor_bytes: MessageSize = 35
    """Size of the description of each sensor."""
    object_bytes: MessageSize = 35
    """Size of each object."""


class DataMessage(CompactModel):
    """Sensor data or network features, as a load of given size on the channel.

    The data are not written a second time: a reader finds the sender's files of the frame.
    """

    period_s: Period = 0.1
    """Time between messages."""
    size_bytes: MessageSize = 100_000
    """Size of one."""


class Channel(Declaration):
    """The V2X channel between all agents of a scenario."""

    kind: Literal["channel"] = "channel"
    range_m: Annotated[PositiveMetres, Field(ge=1)] | None = None
    """Distance beyond which messages do not arrive; `null` is none."""
    radio: Radio | None = None
    """Radio; `null` is a channel limited only by range, loss and bandwidth."""
    rate_mbit_s: Annotated[MegabitsPerSecond, Field(ge=0.001)] | None = None
    """Data rate of the medium, which all stations share: the messages of a tick follow each other;
    `null` is no limit."""
    latency: Latency = Latency()
    """Delay of messages."""
    lifetime_s: Annotated[Seconds, Field(ge=0.01, le=10)] = 1
    """Age from which a message is worthless: it is not received any more."""
    loss: Loss = Loss()
    """Loss from other causes than the link budget."""
    pose_error: PoseError = PoseError()
    """Errors of the sent poses."""
    clock: Clock = Clock()
    """Errors of the sent times."""
    cam: AwarenessMessage | None = AwarenessMessage()
    """Messages about the sender; `null` is none."""
    cpm: PerceptionMessage | None = PerceptionMessage()
    """Messages about its perceived objects; `null` is none."""
    data: DataMessage | None = None
    """Messages with sensor data or features; `null` is none."""

    @model_validator(mode="after")
    def _check_messages(self) -> Self:
        if self.cam is None and self.cpm is None and self.data is None:
            message = "sends nothing: `cam`, `cpm` and `data` are all null"
            raise InvalidCombination((), message, "keep one of them")
        if self.latency.minimum_s >= self.lifetime_s:
            message = f"{self.latency.minimum_s:g} s is not below lifetime_s, {self.lifetime_s:g} s"
            hint = "raise lifetime_s, or nothing ever arrives"
            raise InvalidCombination(
                ("latency", "minimum_s"), message, hint, other_path=("lifetime_s",)
            )
        return self

    @property
    def periods_s(self) -> dict[str, float]:
        """Periods of the periodic messages, by field."""
        kinds = {"cam": self.cam, "cpm": self.cpm, "data": self.data}
        return {
            name: item.period_s
            for name, item in kinds.items()
            if item is not None and getattr(item, "generation", "periodic") == "periodic"
        }
