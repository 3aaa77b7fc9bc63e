"""What people wear and carry.

The catalogue of bodies that traffic is drawn from: what each is, how big, and how it looks.
"""

from pathlib import PurePosixPath
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import CompactModel, Declaration, Digest, Id
from advercity_dsl.traffic import ActorClass
from advercity_dsl.units import (
    Count,
    Degrees,
    Fraction,
    Number,
    Point3,
    PositiveMetres,
    RangeReason,
)

ClothColour = Literal[
    "dark", "black", "grey", "light", "white", "blue", "denim", "red", "green", "brown", "yellow"
]
"""Colour of clothes and bags."""


class PedestrianAppearance(CompactModel):
    """How a pedestrian looks; the top has the actor's own colour."""

    stout: Annotated[
        Number,
        Field(ge=0.75, le=1.4),
        RangeReason("figures beyond that would need another skeleton"),
    ] = 1.0
    """Girth, 1 for an average figure."""
    top: Literal["jacket", "coat", "shirt"] = "jacket"
    """A coat reaches to the knees, a shirt has short sleeves."""
    bottom: Literal["trousers", "shorts", "skirt"] = "trousers"
    """What is worn below."""
    bottom_colour: ClothColour = "dark"
    """Of what is worn below."""
    hair: Literal["short", "long", "bun", "bald", "hat", "hood"] = "short"
    """How it is worn, or what covers it."""
    hair_colour: Literal["black", "brown", "blond", "grey", "red"] = "brown"
    """Of the hair, where it shows."""
    skin: Literal["light", "brown", "dark"] = "light"
    """Tone of the skin."""
    bag: Literal["none", "backpack", "shoulder_bag", "case"] = "none"
    """What is carried."""
    bag_colour: ClothColour = "dark"
    """Of the bag, and of a hat; a hood has the colour of the top."""
    umbrella: ClothColour | None = None
    """Colour of the umbrella that may go up in rain; `null` has none."""


PaintColour = Literal[
    "white", "silver", "grey", "black", "blue", "red", "green", "brown", "yellow", "orange"
]
"""Of car paint."""
PaintFraction = Annotated[Fraction, Field(gt=0)]
MaterialPart = Literal[
    "paint",
    "white_paint",
    "black_paint",
    "red_paint",
    "blue_paint",
    "glass",
    "rubber",
    "chrome",
    "metal",
    "plastic",
    "interior",
    "plate",
    "headlamp",
    "tail_lamp",
    "indicator",
    "by_colour",
    "none",
]
"""What a material of a model stands for; `by_colour` sorts the triangles of a textured one into
lamps, metal and plastic, `none` leaves them out."""
FreeLicence = Literal["CC0-1.0", "CC-BY-3.0", "CC-BY-3.0-US", "CC-BY-4.0", "CC-BY-SA-4.0", "MIT"]


class LampPositions(CompactModel):
    """Middles of lamps in the body frame, on the left; each has a twin on the right if y is not 0.

    What is not given is found on the body: where its lamp glasses are.
    """

    low_beam: Point3 | None = None
    """Headlamps."""
    rear: Point3 | None = None
    """Tail and brake lamps."""
    front_fog: Point3 | None = None
    """Fog lamps in front."""
    rear_fog: Point3 | None = None
    """Fog lamps behind."""
    front_indicator: Point3 | None = None
    """Indicators in front."""
    rear_indicator: Point3 | None = None
    """Indicators behind."""


class Saddle(CompactModel):
    """Where somebody sits on a model that is ridden; places in the body frame, on the left."""

    machine_height_m: PositiveMetres
    """Of the model alone, from the ground; the blueprint's height is that of the helmet."""
    seat: Point3
    """What is sat on."""
    grip: Point3
    """Of the handlebar."""
    peg: Point3
    """What the ball of a foot rests on."""
    lean_deg: Degrees = 5
    """Of the back, forward; more if the hands do not reach the grips."""


class BodyModel(CompactModel):
    """A 3-D model that a body is made of, scaled to the size of its blueprint.

    It is one of the asset pack, or a GLB file beside the declaration.
    """

    pack: Annotated[str, Field(pattern=r"^[\w-]+/[\w.-]+$")] | None = None
    """`collection/model` of Debian's sweethome3d-furniture, such as `scopia/seat_leon`."""
    file: Annotated[str, Field(pattern=r"^[^/\\].*\.glb$")] | None = None
    """Path of a GLB file, relative to the declaration's file."""
    sha256: Digest | None = None
    """Of the file; the compiler writes it into the spec."""
    up: Literal["y", "z"] = "y"
    """Axis of the model that points up."""
    turn_deg: Degrees = 0
    """Turn about the vertical, to the left, that brings its front ahead. None is needed where y is
    up and the front faces along z, as glTF has it, or where z is up and it faces along x."""
    materials: dict[str, MaterialPart] = Field(default_factory=dict[str, MaterialPart])
    """What its materials stand for, where their names do not tell."""
    triangles: Annotated[
        Count,
        Field(ge=200, le=60_000),
        RangeReason("fewer lose its shape, and more slow every picture of a hundred such bodies"),
    ] = 9000
    """It is thinned to about so many."""
    ridden: Saddle | None = None
    """Of a motorcycle: somebody is put on it."""
    author: str
    """Who made the model."""
    licence: FreeLicence
    """Under which terms."""

    @model_validator(mode="after")
    def _check_source(self) -> Self:
        if (self.pack is None) == (self.file is None):
            raise ValueError("write either `pack: collection/model` or `file: model.glb`")
        if self.file is not None and ".." in PurePosixPath(self.file).parts:
            raise ValueError(f"'{self.file}' leads out of the declaration's folder")
        return self


class Blueprint(CompactModel):
    """A kind of actor; full length, width and height of its box."""

    actor_class: ActorClass
    """What kind of traffic it is."""
    length_m: PositiveMetres
    """Of its box, bumper to bumper."""
    width_m: PositiveMetres
    """Of its box."""
    height_m: PositiveMetres
    """Of its box, from the ground."""
    land_use: Literal["urban", "rural", "any"] = "any"
    """Where it is met."""
    paints: dict[PaintColour, PaintFraction] = Field(default_factory=dict[PaintColour, float])
    """Shares of the colours of its painted parts; those of real traffic if not given."""
    lamps: LampPositions = LampPositions()
    """Where its lamps are, if not where its lamp glasses are."""
    looks: PedestrianAppearance | None = None
    """Of a pedestrian; drawn by the blueprint's id if not given."""
    model: BodyModel | None = None
    """A 3-D model; left out, the program shapes the body."""


class Catalogue(Declaration):
    """The blueprints that a suite draws from; `ego` is the connected vehicles' blueprint."""

    kind: Literal["catalogue"] = "catalogue"
    ego: Id
    """Blueprint of every connected vehicle."""
    blueprints: Annotated[dict[Id, Blueprint], Field(min_length=1)]
    """What other traffic is drawn from."""
