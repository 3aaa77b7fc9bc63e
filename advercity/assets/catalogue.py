"""The catalogue's bodies on this machine: which models are here, and what each body weighs."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from advercity_dsl import Blueprint, Catalogue
from advercity_dsl.base import suggest_name

from advercity.assets.bodies import build_body
from advercity.assets.model_store import ModelStore
from advercity.compiler.library import find_shipped_library, load_library
from advercity.errors import InputError
from advercity.world import Body


@dataclass(frozen=True)
class BodyFacts:
    """One row of the list of bodies.

    Attributes:
        name: Of the blueprint.
        blueprint: What it is.
        triangles: Of its body.
        size_mib: What vertices, triangles and normals take in memory.
        has_model: Whether a model stands for it, or it is shaped here.
    """

    name: str
    blueprint: Blueprint
    triangles: int
    size_mib: float
    has_model: bool

    def to_row(self) -> dict[str, str | int | float]:
        """The row, by its heads."""
        made = self.blueprint
        return {
            "blueprint": self.name,
            "class": made.actor_class,
            "size m": f"{made.length_m:.2f} x {made.width_m:.2f} x {made.height_m:.2f}",
            "triangles": self.triangles,
            "MiB": round(self.size_mib, 2),
            "made of": self.source,
            "author, licence": self.terms,
        }

    @property
    def source(self) -> str:
        """What the body is made of."""
        model = self.blueprint.model
        if model is None:
            return "shaped here"
        name = model.pack or model.file or ""
        return name if self.has_model else f"shaped here; {name} is not installed"

    @property
    def terms(self) -> str:
        """Author and licence of the model."""
        model = self.blueprint.model
        return f"{model.author}, {model.licence}" if model and self.has_model else "MIT"


def load_catalogue_blueprints(*library: Path) -> dict[str, Blueprint]:
    """Blueprints of every catalogue of a library's folders, or of the one that ships."""
    catalogues = load_library(*(library or [find_shipped_library()])).get_declarations(Catalogue)
    return {
        name: blueprint
        for catalogue in catalogues.values()
        for name, blueprint in catalogue.blueprints.items()
    }


def select_blueprints(
    blueprints: Mapping[str, Blueprint], names: list[str]
) -> dict[str, Blueprint]:
    """Those with these names, or all if there are none; InputError if one is not there."""
    for name in names:
        if name not in blueprints:
            raise InputError(f"there is no blueprint '{name}'; {suggest_name(name, blueprints)}")
    return {name: blueprints[name] for name in names} if names else dict(blueprints)


def compute_body_facts(name: str, blueprint: Blueprint, shelf: ModelStore) -> BodyFacts:
    """What a blueprint's body weighs; RunError if its model is here but cannot be used."""
    made = build_body(name, blueprint, shelf)
    return BodyFacts(
        name,
        blueprint,
        triangles=sum(len(part.triangles) for part in made.parts),
        size_mib=_count_bytes(made) / 2**20,
        has_model=shelf.prepare_model(blueprint) is not None,
    )


def _count_bytes(made: Body) -> int:
    arrays = [(part.vertices, part.triangles, part.normals) for part in made.parts]
    return sum(array.nbytes for some in arrays for array in some if array is not None)
