"""Lists the bodies of catalogues: which models are installed, and how large each body is."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from advercity_dsl import Blueprint, Catalogue
from advercity_dsl.base import suggest_name

from advercity.assets.bodies import build_body
from advercity.assets.model_conversion import format_model_name
from advercity.assets.model_store import ModelStore
from advercity.compiler.library import load_library
from advercity.compiler.shipped_library import find_shipped_library
from advercity.errors import InputError


@dataclass(frozen=True)
class BodyFacts:
    """One row of the list of bodies.

    Attributes:
        name: Id of the blueprint.
        blueprint: The blueprint of the body.
        triangles: Triangles of the body.
        size_mib: Memory of its vertices, triangles and normals.
        has_model: Whether the body is an installed model, not a procedural shape.
    """

    name: str
    blueprint: Blueprint
    triangles: int
    size_mib: float
    has_model: bool

    def to_row(self) -> dict[str, str | int | float]:
        """Return the row by its column heads."""
        blueprint = self.blueprint
        return {
            "blueprint": self.name,
            "class": blueprint.actor_class,
            "size m": f"{blueprint.length_m:.2f} x {blueprint.width_m:.2f}"
            f" x {blueprint.height_m:.2f}",
            "triangles": self.triangles,
            "MiB": round(self.size_mib, 2),
            "model": self.source,
            "attribution": self.attribution,
        }

    @property
    def source(self) -> str:
        """The model behind the body, or `procedural`."""
        model = self.blueprint.model
        if model is None:
            return "procedural"
        name = format_model_name(model)
        return name if self.has_model else f"procedural; {name} is not installed"

    @property
    def attribution(self) -> str:
        """Author and licence of the model; procedural bodies have the project's licence."""
        model = self.blueprint.model
        return f"{model.author}, {model.licence}" if model and self.has_model else "MIT"


def load_catalogue_blueprints(*library: Path) -> dict[str, Blueprint]:
    """Load the blueprints of every catalogue in library folders; no folder: the shipped library."""
    catalogues = load_library(*(library or [find_shipped_library()])).get_declarations(Catalogue)
    return {
        name: blueprint
        for catalogue in catalogues.values()
        for name, blueprint in catalogue.blueprints.items()
    }


def select_blueprints(
    blueprints: Mapping[str, Blueprint], names: list[str]
) -> dict[str, Blueprint]:
    """Select blueprints by name, or all if no name is given; InputError for an unknown name."""
    for name in names:
        if name not in blueprints:
            raise InputError(f"there is no blueprint '{name}'; {suggest_name(name, blueprints)}")
    return {name: blueprints[name] for name in names} if names else dict(blueprints)


def compute_body_facts(name: str, blueprint: Blueprint, store: ModelStore) -> BodyFacts:
    """Build the body of a blueprint and measure it.

    Raises:
        RunError: Its model is installed, but cannot be used.
    """
    has_model = store.prepare_model(blueprint) is not None
    parts = build_body(name, blueprint, store if has_model else None).parts
    arrays = [a for part in parts for a in (part.vertices, part.triangles, part.normals)]
    return BodyFacts(
        name,
        blueprint,
        triangles=sum(len(part.triangles) for part in parts),
        size_mib=sum(array.nbytes for array in arrays if array is not None) / 2**20,
        has_model=has_model,
    )
