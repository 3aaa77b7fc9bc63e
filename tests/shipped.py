"""The shipped library and its bodies, made once per process when first needed."""

import functools
from collections.abc import Iterator, Mapping

from advercity_dsl import ActorClass, Catalogue

from advercity.assets.bodies import build_body
from advercity.compiler import find_shipped_library, load_library
from advercity.world import Body

LIBRARY = load_library(find_shipped_library())
CATALOGUE = LIBRARY.get_declarations(Catalogue)["adver_city"]


@functools.cache
def _build_body(name: str) -> Body:
    return build_body(name, CATALOGUE.blueprints[name])


class ShippedBodies(Mapping[str, Body]):
    """Procedural bodies of the catalogue's blueprints, of some classes or of all."""

    def __init__(self, *classes: ActorClass) -> None:
        blueprints = CATALOGUE.blueprints.items()
        self._names = [n for n, made in blueprints if not classes or made.actor_class in classes]

    def __getitem__(self, name: str) -> Body:
        if name not in self._names:
            raise KeyError(name)
        return _build_body(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)
