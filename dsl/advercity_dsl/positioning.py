"""Satellite positioning: error models, and receivers with reception, tracking and solution."""

from datetime import datetime
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from advercity_dsl.base import CompactModel, InvalidCombination, Items
from advercity_dsl.sampling import Sampled
from advercity_dsl.sun_position import is_date_alone
from advercity_dsl.units import Decibels, Degrees, Hertz, Metres, Number, RangeReason, Seconds

ConstellationName = Literal["gps", "galileo", "glonass", "beidou"]
AntennaOffset = Annotated[Metres, Field(ge=-100, le=100)]


class SatelliteReceiver(CompactModel):
    """A receiver among buildings and trees: it ranges to satellites and solves for its position.

    The defaults describe a good single-frequency receiver in a car, without corrections.
    """

    start_utc: str = "2024-06-21T12:00:00"
    """Date and time at the scenario's start, as ISO 8601: it decides where satellites are."""
    constellations: Annotated[Items[ConstellationName], Field(min_length=1, max_length=4)] = (
        "gps",
        "galileo",
    )
    """Whose satellites it receives; every constellation has 24."""
    antenna_m: tuple[AntennaOffset, AntennaOffset, AntennaOffset] = (0, 0, 1.5)
    """Place of the antenna on the carrier: forward, left, up. Fixes are of the carrier's origin."""
    mask_deg: Annotated[Degrees, Field(ge=0, le=60)] = 5
    """Elevation above which satellites are used."""
    cn0_zenith_db_hz: Annotated[Number, Field(ge=30, le=60)] = 48
    """Carrier over noise density of an open signal from the zenith, dB-Hz."""
    cn0_drop_db: Annotated[Decibels, Field(ge=0, le=30)] = 10
    """Loss at the horizon, relative to the zenith."""
    tracking_db_hz: Annotated[Number, Field(ge=10, le=45)] = 25
    """Carrier over noise density below which a signal is lost."""
    carrier_db_hz: Annotated[Number, Field(ge=10, le=50)] = 35
    """Below this, the phase of its carrier is lost."""
    correlator_chips: Annotated[Number, Field(ge=0.02, le=1)] = 0.1
    """Spacing of the early and the late correlator: wide ones err more by reflections."""
    loop_hz: Annotated[Hertz, Field(ge=0.05, le=20)] = 1
    """Bandwidth of the tracking of the code."""
    cross_polar_db: Annotated[Decibels, Field(ge=0, le=40)] = 10
    """Suppression of signals whose polarisation a reflection has turned, by the antenna."""
    signal_error_m: Annotated[Metres, Field(ge=0, le=100)] = 0.5
    """Standard deviation of orbit and clock of each satellite."""
    atmosphere_m: Annotated[Metres, Field(ge=0, le=100)] = 1.0
    """Standard deviation of the error of the air's delay, at the zenith."""
    corrections: Literal["none", "rtk"] = "none"
    """Whether carrier phases are corrected by a base station."""
    base_km: Annotated[Number, Field(ge=0, le=100)] = 5
    """Distance of the base station: errors of a millionth of it remain."""
    time_to_fix_s: Annotated[Seconds, Field(ge=0, le=120)] = 10
    """Time for which five carriers must be tracked without a break until ambiguities are fixed."""
    heading_baseline_m: Annotated[Metres, Field(ge=0, le=20)] = 0
    """Distance of a second antenna ahead of the first, which gives the heading; 0 is none."""

    @field_validator("start_utc")
    @classmethod
    def _check_start(cls, text: str) -> str:
        try:
            has_offset = datetime.fromisoformat(text).tzinfo is not None
        except ValueError as error:
            raise ValueError(f"'{text}' is no time; write e.g. 2024-06-21T12:00:00") from error
        if is_date_alone(text):
            raise ValueError(f"'{text}' is a date without a time; add one, as in {text}T12:00:00")
        if has_offset:
            raise ValueError(f"'{text}' has an offset; write the time in UTC without one")
        return text


class Gnss(Sampled):
    """Satellite positioning: with noise alone, or by satellites among walls and trees.

    `carla` uses the noise in degrees and `altitude_noise_m`; `realistic` white noise plus a
    first-order Gauss-Markov error, both in metres and larger vertically; `satellites` ranges to
    satellites as `receiver` says.
    """

    mode: Literal["carla", "realistic", "satellites"] = "carla"
    """Error model: CARLA's, a real receiver in the open, or satellites above the place."""
    receiver: SatelliteReceiver = SatelliteReceiver()
    """The receiver, for `satellites`."""
    latitude_noise_deg: Annotated[
        Degrees, Field(ge=0, le=0.01), RangeReason("0.01 deg are a kilometre")
    ] = 0
    """Standard deviation of the latitude, for `carla`."""
    longitude_noise_deg: Annotated[
        Degrees, Field(ge=0, le=0.01), RangeReason("0.01 deg are a kilometre")
    ] = 0
    """Standard deviation of the longitude, for `carla`."""
    altitude_noise_m: Annotated[
        Metres, Field(ge=0, le=1000), RangeReason("no receiver errs by a kilometre")
    ] = 0
    """Standard deviation of the altitude, for `carla`."""
    white_noise_m: Annotated[Metres, Field(ge=0, le=100)] = 0.3
    """Standard deviation of the white noise, for `realistic`."""
    wander_m: Annotated[Metres, Field(ge=0, le=100)] = 1.0
    """Standard deviation of the Gauss-Markov error, for `realistic`."""
    wander_time_s: Annotated[Seconds, Field(ge=1, le=3600)] = 120
    """Correlation time of the Gauss-Markov error, for `realistic`."""
    vertical_factor: Annotated[Number, Field(ge=0, le=10)] = 1.75
    """Factor of vertical errors over horizontal ones, for `realistic`."""

    @model_validator(mode="after")
    def _check_receiver(self) -> Self:
        if self.mode != "satellites" and self.receiver != SatelliteReceiver():
            message = f"has no effect with mode {self.mode}"
            raise InvalidCombination(("receiver",), message, "write mode: satellites")
        return self
