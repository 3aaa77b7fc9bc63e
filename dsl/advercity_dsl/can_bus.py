"""Signals of a vehicle's own bus: wheels, steering, yaw rate, brake and indicators."""

from typing import Annotated

from pydantic import Field

from advercity_dsl.sampling import Sampled
from advercity_dsl.units import Degrees, Fraction, KilometresPerHour, Number


class CanBus(Sampled):
    """Motion of a vehicle on its bus, in the steps of its messages.

    The steps of wheels and steering are a Toyota Corolla's, as opendbc describes its bus;
    the step of the yaw rate and the errors are assumed.
    """

    wheel_speed_step_km_h: Annotated[KilometresPerHour, Field(ge=0, le=10)] = 0.01
    """Step of the wheels' speeds and of the vehicle's."""
    tyre_error: Annotated[Fraction, Field(le=0.1)] = 0.005
    """Standard deviation of each tyre's rolling radius, by wear and pressure."""
    steering_ratio: Annotated[Number, Field(ge=1, le=40)] = 15
    """Angle of the steering wheel over the angle of the front wheels."""
    steering_step_deg: Annotated[Degrees, Field(ge=0, le=10)] = 0.1
    """Step of the angle of the steering wheel."""
    steering_offset_deg: Annotated[Degrees, Field(ge=0, le=30)] = 1
    """Standard deviation of its zero."""
    yaw_rate_step_deg_s: Annotated[Number, Field(ge=0, le=10)] = 0.1
    """Step of the yaw rate, degrees per second."""
    yaw_rate_offset_deg_s: Annotated[Number, Field(ge=0, le=10)] = 0.2
    """Standard deviation of its zero, degrees per second."""
