"""Entities of a scenario: their kinds and sizes."""

from collections.abc import Iterator, Mapping
from xml.etree.ElementTree import Element

from advercity_dsl import ActorClass

from advercity.recordings.openscenario.document import Scope
from advercity.recordings.openscenario.stage import Entity
from advercity.recordings.openscenario.tracks import format_id

CATEGORIES: Mapping[str, ActorClass] = {
    "car": "car",
    "van": "van",
    "truck": "truck",
    "bus": "truck",
    "trailer": "truck",
    "semitrailer": "truck",
    "motorbike": "motorcycle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
    "wheelchair": "pedestrian",
}
"""Classes by `vehicleCategory` and `pedestrianCategory`."""
ATTRIBUTES = {"Vehicle": "vehicleCategory", "Pedestrian": "pedestrianCategory"}
BODILESS = ("MiscObject", "ExternalObjectReference")
"""Entities other than road users: left out, or refused by the table."""


def read_entities(scope: Scope) -> Iterator[Entity]:
    """Read the road users; problems are kept in the scope, others are left out."""
    names: dict[str, str] = {}
    for item in scope.source.root.iterfind("Entities/ScenarioObject"):
        name = scope.get(item, "name")
        scope.findings.entities.add(name)
        found = scope.resolve(item, *ATTRIBUTES, *BODILESS)
        if found is None:
            continue
        inner, body = found
        if body.tag in BODILESS:
            continue
        if body.tag not in ATTRIBUTES:  # an entry of another catalogue
            inner.refuse(body, f"is no body of '{name}'", "write a <Vehicle> or <Pedestrian>")
            continue
        category = inner.get(body, ATTRIBUTES[body.tag])
        if category not in CATEGORIES:
            hint = f"these are read: {', '.join(CATEGORIES)}"
            inner.refuse(body, f"'{name}' is a {category}, for which there is no body", hint)
            continue
        track = format_id(name)
        if track in names:
            message = f"'{name}' and '{names[track]}' are both the track '{track}'"
            scope.refuse(item, message, "rename one of them")
            continue
        names[track] = name
        towed = body.find("Trailer/TrailerRef")
        if towed is not None and inner.get(towed, "entityRef", ""):
            inner.refuse(towed, "another entity is towed, which is not played", "leave it out")
            continue
        box = body.find("BoundingBox")
        if box is None:
            inner.refuse(body, f"'{name}' has no <BoundingBox>")
            continue
        yield _read_box(inner, name, CATEGORIES[category], box)


def _read_box(scope: Scope, name: str, actor_class: ActorClass, box: Element) -> Entity:
    centre, extent = box.find("Center"), box.find("Dimensions")
    size, offset = (0.0, 0.0, 0.0), 0j
    if extent is not None:
        length, width, height = (
            scope.get_number(extent, key) for key in ("length", "width", "height")
        )
        size = (length, width, height)
    if centre is not None:
        offset = complex(scope.get_number(centre, "x"), scope.get_number(centre, "y"))
    return Entity(name, actor_class, size, offset)
