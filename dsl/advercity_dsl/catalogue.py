"""Catalogues of blueprints: class, size and appearance of the actors in traffic."""

from pathlib import PurePosixPath
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import (
    ByName,
    CompactModel,
    Declaration,
    Digest,
    Id,
    InvalidCombination,
)
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
"""Colours of clothes and bags."""


class PedestrianAppearance(CompactModel):
    """Appearance of a pedestrian; the top has the actor's own colour."""

    stout: Annotated[
        Number,
        Field(ge=0.75, le=1.4),
        RangeReason("other figures would need another skeleton"),
    ] = 1.0
    """Girth relative to an average figure."""
    top: Literal["jacket", "coat", "shirt"] = "jacket"
    """Garment of the upper body: a coat ends at the knees, a shirt has short sleeves."""
    bottom: Literal["trousers", "shorts", "skirt"] = "trousers"
    """Garment of the legs."""
    bottom_colour: ClothColour = "dark"
    """Colour of the garment."""
    hair: Literal["short", "long", "bun", "bald", "hat", "hood"] = "short"
    """Hairstyle or headwear."""
    hair_colour: Literal["black", "brown", "blond", "grey", "red"] = "brown"
    """Colour of visible hair."""
    skin: Literal["light", "brown", "dark"] = "light"
    """Tone of the skin."""
    bag: Literal["none", "backpack", "shoulder_bag", "case"] = "none"
    """Carried bag."""
    bag_colour: ClothColour = "dark"
    """Colour of the bag and of a hat; a hood has the colour of the top."""
    umbrella: ClothColour | None = None
    """Colour of an umbrella for rain; `null` for none."""
    attachment: Literal["none", "pram", "dog", "wheelchair", "pushed_wheelchair"] = "none"
    """Companion in the same box: a pram in front of the person, a dog on a leash at its right, a
    wheelchair under it, or one with another person, pushed by it. Cloth of prams and wheelchairs
    has the colour of the bag."""

    @model_validator(mode="after")
    def _check_hands(self) -> Self:
        if self.attachment != "none" and (self.umbrella is not None or self.bag == "case"):
            raise ValueError(
                f"hands busy with `attachment: {self.attachment}` hold no umbrella and no case"
            )
        return self


class PersonShape(CompactModel):
    """Body of a person from MakeHuman's base mesh; the blueprint gives the height."""

    sex: Literal["female", "male"]
    """Sex."""
    age_years: Annotated[
        Number, Field(ge=4, le=90), RangeReason("younger ones do not walk alone")
    ] = 35
    """Age."""
    weight: Fraction = 0.5
    """Weight for the height: 0 thin, 0.5 average, 1 heavy."""
    muscle: Fraction = 0.5
    """Muscles: 0 weak, 0.5 average, 1 strong."""
    ancestry: Literal["african", "asian", "european"] = "european"
    """Ancestry, which shapes the face."""
    others: Annotated[
        Count, Field(ge=0, le=20), RangeReason("every body of a blueprint takes memory")
    ] = 4
    """Number of further people in boxes of the same size, of drawn shapes and looks."""


SEATED_HEIGHT_RATIO = 0.8
"""Height of a person in a wheelchair over its height when standing."""


PaintColour = Literal[
    "white", "silver", "grey", "black", "blue", "red", "green", "brown", "yellow", "orange"
]
"""Colours of car paint."""
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
"""Meaning of a model's material; `by_colour` sorts the triangles of a textured material into
lamps, metal and plastic, `none` omits them."""
FreeLicence = Literal["CC0-1.0", "CC-BY-3.0", "CC-BY-3.0-US", "CC-BY-4.0", "CC-BY-SA-4.0", "MIT"]


class LampPositions(CompactModel):
    """Centres of the left lamps in the body frame, mirrored to the right if y is not 0.

    Missing positions are derived from the lamp glasses of the body.
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
    """Contact points of a rider on a model, in the body frame, on the left side."""

    machine_height_m: Annotated[PositiveMetres, Field(ge=0.1, le=5)]
    """Height of the model alone; the blueprint's height includes the rider."""
    seat: Point3
    """Seat."""
    grip: Point3
    """Grip of the handlebar."""
    peg: Point3
    """Footrest."""
    lean_deg: Annotated[Degrees, Field(ge=-90, le=90)] = 5
    """Forward lean of the back; increased if the hands would miss the grips."""


class BodyModel(CompactModel):
    """A 3-D model, scaled to the size of its blueprint.

    It comes from an asset pack, or from a GLB file next to the declaration.
    """

    pack: Annotated[str, Field(pattern=r"^[\w-]+/[\w.-]+$")] | None = None
    """Model of Debian's sweethome3d-furniture as `collection/model`: `scopia/seat_leon`."""
    file: Annotated[str, Field(pattern=r"^[^/\\].*\.glb$")] | None = None
    """Path of a GLB file, relative to the declaration's file."""
    person: PersonShape | None = None
    """People of MakeHuman's base mesh, dressed as the blueprint's looks say."""
    sha256: Digest | None = None
    """SHA-256 of the file, which the compiler writes into the spec."""
    up: Literal["y", "z"] = "y"
    """Upward axis of the model."""
    turn_deg: Degrees = 0
    """Counter-clockwise rotation about the vertical, to turn its front ahead. 0 is right if y is up
    and the front faces along z, as in glTF, or if z is up and it faces along x."""
    materials: dict[str, MaterialPart] = Field(
        default_factory=dict[str, MaterialPart], max_length=1000
    )
    """Meanings of its materials, unless their names say it."""
    triangles: Annotated[
        Count,
        Field(ge=200, le=60_000),
        RangeReason("fewer lose its shape, and more slow down images of a hundred such bodies"),
    ] = 9000
    """Number of triangles to which it is simplified."""
    ridden: Saddle | None = None
    """Contact points of the rider of a motorcycle."""
    author: str
    """Author of the model."""
    licence: FreeLicence
    """Licence of the model."""

    @model_validator(mode="after")
    def _check_source(self) -> Self:
        if [self.pack, self.file, self.person].count(None) != 2:
            raise ValueError(
                "write one of `pack: collection/model`, `file: model.glb` and `person: {sex: ...}`"
            )
        # Declarations come from others: they must not read files elsewhere.
        if self.file is not None and ".." in PurePosixPath(self.file).parts:
            raise ValueError(f"'{self.file}' is outside the declaration's folder")
        return self


ActorMetres = Annotated[
    PositiveMetres, Field(ge=0.1, le=50), RangeReason("no road user is smaller or larger")
]


class FifthWheel(CompactModel):
    """Coupling of a tractor unit: its semi-trailer and its fifth wheel."""

    trailer: Id
    """Blueprint of the semi-trailer, in the same catalogue."""
    behind_front_m: ActorMetres
    """Distance of the fifth wheel behind the front of the tractor unit."""


class SemiTrailer(CompactModel):
    """Kingpin and axles of a semi-trailer."""

    kingpin_m: ActorMetres
    """Distance of the kingpin behind the front of the semi-trailer."""
    wheelbase_m: ActorMetres
    """Distance of the middle of its axles behind the kingpin."""
    body: Literal["curtains", "refrigerated"] = "curtains"
    """Walls around its cargo: curtains, or insulated walls with a cooling unit."""


class Blueprint(CompactModel):
    """A kind of actor, with the full length, width and height of its box."""

    actor_class: ActorClass
    """Class of traffic."""
    length_m: ActorMetres
    """Length of its box, bumper to bumper."""
    width_m: ActorMetres
    """Width of its box."""
    height_m: ActorMetres
    """Height of its box above the ground."""
    land_use: Literal["urban", "rural", "any"] = "any"
    """Surroundings in which it occurs."""
    paints: dict[PaintColour, PaintFraction] = Field(default_factory=dict[PaintColour, float])
    """Fractions of paint colours; by default as in real traffic."""
    lamps: LampPositions = LampPositions()
    """Positions of lamps, if they differ from its lamp glasses."""
    headlamps: Literal["halogen", "led"] | None = None
    """Light sources of its headlamps; without them, `lamps.led` of the weather has the fraction."""
    looks: PedestrianAppearance | None = None
    """Appearance of a pedestrian; derived from the blueprint's id if not given."""
    fraction: Annotated[Fraction, Field(gt=0)] | None = None
    """Its fraction of a road's drawn pedestrians, or trucks; the others are of blueprints without a
    fraction, as many of each. Staged and recorded ones are never of it."""
    tows: FifthWheel | None = None
    """Semi-trailer of a tractor unit, which never drives without it."""
    semitrailer: SemiTrailer | None = None
    """Marks a truck as a semi-trailer, which only drives behind its tractor unit."""
    model: BodyModel | None = None
    """A 3-D model; without it, the body is generated."""

    @property
    def size(self) -> tuple[float, float, float]:
        """Length, width and height of its box in metres."""
        return self.length_m, self.width_m, self.height_m

    @property
    def person(self) -> PersonShape | None:
        """Person of its model, if it is one."""
        return self.model.person if self.model else None

    @property
    def model_size(self) -> tuple[float, float, float]:
        """Length, width and height in metres to which its model is scaled."""
        # A rider sits on top of the machine, whose model is therefore lower than the box.
        ridden = self.model.ridden if self.model else None
        return self.length_m, self.width_m, ridden.machine_height_m if ridden else self.stature_m

    @property
    def stature_m(self) -> float:
        """Height of its pedestrian standing up, in metres; for others the box's height."""
        is_seated = self.looks is not None and self.looks.attachment == "wheelchair"
        return round(self.height_m / SEATED_HEIGHT_RATIO, 3) if is_seated else self.height_m

    @property
    def is_usual(self) -> bool:
        """Whether its class alone decides if it is drawn: it has no fraction and is not towed."""
        return self.fraction is None and self.semitrailer is None

    @model_validator(mode="after")
    def _check_fraction(self) -> Self:
        if self.fraction is not None and self.actor_class not in ("pedestrian", "truck"):
            raise ValueError(
                f"`fraction` is for pedestrians and trucks, not for a {self.actor_class}"
            )
        return self

    @model_validator(mode="after")
    def _check_coupling(self) -> Self:
        if (self.tows or self.semitrailer) and self.actor_class != "truck":
            raise ValueError(
                f"`tows` and `semitrailer` are for trucks, not for a {self.actor_class}"
            )
        if self.tows:
            if self.fraction is None or self.semitrailer:
                raise ValueError("a tractor unit has a `fraction`, and is no semi-trailer")
            if self.tows.behind_front_m >= self.length_m:
                raise ValueError("the fifth wheel is behind the tractor unit; move it forward")
        if self.semitrailer:
            if self.fraction is not None:
                raise ValueError("a semi-trailer has no `fraction`: its tractor unit has it")
            if self.semitrailer.kingpin_m + self.semitrailer.wheelbase_m >= self.length_m:
                raise ValueError("its axles are behind the semi-trailer; move them forward")
        return self


class Catalogue(Declaration):
    """Blueprints from which traffic is drawn."""

    kind: Literal["catalogue"] = "catalogue"
    ego: Id
    """Blueprint of every connected vehicle."""
    blueprints: Annotated[ByName[Blueprint], Field(min_length=1)]
    """Blueprints of the background traffic."""

    @model_validator(mode="after")
    def _check_fractions(self) -> Self:
        for kind in ("pedestrian", "truck"):
            same = (item for item in self.blueprints.values() if item.actor_class == kind)
            total = sum(item.fraction or 0.0 for item in same)
            if total > 1.0:
                raise ValueError(f"fractions of {kind}s add up to {total:g}; make it 1 or less")
        return self

    @model_validator(mode="after")
    def _check_trailers(self) -> Self:
        for name, item in self.blueprints.items():
            if item.tows is None:
                continue
            path = ("blueprints", name, "tows", "trailer")
            trailer = self.blueprints.get(item.tows.trailer)
            if trailer is None or trailer.semitrailer is None:
                raise InvalidCombination(
                    path,
                    f"'{item.tows.trailer}' is no semi-trailer of the catalogue",
                    "name a blueprint that has `semitrailer`",
                )
            if trailer.land_use not in ("any", item.land_use):
                raise InvalidCombination(
                    path,
                    f"'{item.tows.trailer}' is {trailer.land_use}, what tows it {item.land_use}",
                    "give both the same `land_use`",
                )
        ego = self.blueprints.get(self.ego)
        if ego is not None and (ego.tows or ego.semitrailer):
            raise InvalidCombination(
                ("ego",), "is articulated", "connected vehicles are rigid cars, vans or trucks"
            )
        return self
