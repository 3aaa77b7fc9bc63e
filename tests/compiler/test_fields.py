"""What the annotations of a model say about the value at a path."""

import pytest
from advercity_dsl import Model
from advercity_dsl.base import ValuePath
from advercity_dsl.units import Degrees, Metres

from advercity.compiler.fields import find_number_constraints


class Route(Model):
    """Tuples of a fixed length, and of any."""

    place: tuple[Metres, Metres, Degrees]
    stations: tuple[Metres, ...]


@pytest.mark.parametrize(
    ("value_path", "unit"),
    [
        (("place", 0), "m"),
        (("place", 1), "m"),
        (("place", 2), "deg"),
        (("place", 3), "deg"),  # one too many, as an author may write
        (("stations", 0), "m"),
        (("stations", 7), "m"),
    ],
)
def test_an_item_has_the_unit_of_its_place_in_a_tuple(value_path: ValuePath, unit: str) -> None:
    found = find_number_constraints(Route, value_path)
    assert found is not None
    assert found.unit_name == unit
