"""Agents placed by the arms of a junction instead of by coordinates."""

from typing import Annotated, Literal

from pydantic import Field

from advercity_dsl.base import Id, Model
from advercity_dsl.units import Degrees, KilometresPerHour, PositiveMetres, Seconds

Arm = Id
"""An arm of a junction: `north`, `east`, `south` or `west`; `opposite`, `left` or `right` of the
ego's; `same` as the ego's; or a street."""


class ArmVehicle(Model):
    """A connected vehicle, placed on an arm of a junction."""

    kind: Literal["vehicle"] = "vehicle"
    """A connected vehicle."""
    role: Literal["ego", "other"] = "other"
    """Role of the vehicle; each road has one ego."""
    arm: Arm | None = None
    """Arm of its approach; by default the busiest, for the ego one where a crossed conflict can be
    staged."""
    turn: Literal["straight", "left", "right"] | None = None
    """Where it goes; by default straight on if it can. A conflict decides where the ego goes."""
    start_m: PositiveMetres = 80
    """Distance of its start before the junction."""
    end_m: PositiveMetres = 60
    """Distance of its destination beyond the junction."""
    max_speed_km_h: Annotated[KilometresPerHour, Field(gt=0, le=200)] = 40
    """Speed limit of the vehicle, which also obeys the street's."""
    waits_s: Annotated[Seconds, Field(ge=0, le=600)] = 0
    """Time for which it waits at its start before it sets out."""


class ArmUnit(Model):
    """Stationary sensors at the right of an arm, which look at the junction."""

    kind: Literal["roadside_unit"] = "roadside_unit"
    """Stationary sensors at the roadside."""
    arm: Arm
    """Arm at whose corner it is."""
    height_m: PositiveMetres = 6
    """Height of the mast's head above the street."""
    pitch_deg: Degrees = 15
    """Positive looks down."""


class JunctionAgents(Model):
    """Agents at a junction, or at each of several, of which every one gives a road.

    Roads of several junctions have the id `<road>_<junction>`.
    """

    junction: Id | Annotated[tuple[Id, ...], Field(min_length=1, max_length=1000)] = "signals"
    """Junction, a list of them, or all with a rule of right of way: `signals`, `stop`, `yield`,
    `none`."""
    agents: Annotated[
        dict[Id, Annotated[ArmVehicle | ArmUnit, Field(discriminator="kind")]],
        Field(min_length=1, max_length=100),
    ]
    """Connected vehicles and roadside units by name; one vehicle is the ego."""
