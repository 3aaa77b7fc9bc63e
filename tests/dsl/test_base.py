import pytest
from advercity_dsl.base import MAX_LISTED_NAMES, CompactModel, InvalidCombination, suggest_name


class Sign(CompactModel):
    text: str
    height_m: float = 2.0


def test_a_similar_name_is_suggested() -> None:
    assert suggest_name("wether", ["road", "weather"]) == "did you mean 'weather'?"


def test_of_names_that_are_as_similar_that_with_the_same_beginning_is_suggested() -> None:
    """Both share three of six and four letters, in order, with `at_min`."""
    assert suggest_name("at_min", ["rain", "at_s"]) == "did you mean 'at_s'?"


def test_without_a_similar_name_all_are_listed() -> None:
    assert suggest_name("x", ["road", "density"]) == "available: density, road"
    assert suggest_name("x", []) == "none available"


def test_long_lists_of_names_are_cut() -> None:
    hint = suggest_name("-", [f"road{number:02}" for number in range(MAX_LISTED_NAMES + 1)])
    assert hint.endswith("road19, ...")


def test_defaults_are_omitted_from_the_json_of_compact_models() -> None:
    assert Sign(text="stop").model_dump() == {"text": "stop"}
    assert Sign(text="stop", height_m=3).model_dump() == {"text": "stop", "height_m": 3}


def test_an_invalid_combination_reads_as_path_message_and_hint() -> None:
    with pytest.raises(InvalidCombination, match=r"fog\.mor_m: is too clear; lower it"):
        raise InvalidCombination(("fog", "mor_m"), "is too clear", "lower it")
