"""Expressions of the standard are computed, and nothing else is."""

import pytest

from advercity.recordings.openscenario.expressions import MAX_EXPRESSION_LENGTH, substitute

PARAMETERS = {"speed": "36", "wet": "true", "side": "left"}


@pytest.mark.parametrize(
    ("text", "expected"),
    {
        "12": "12",
        "$speed": "36",
        "${$speed / 3.6}": "10.0",
        "${-$speed}": "-36.0",
        "${pow(2, 3) + 7 % 4 - abs(-1)}": "10.0",
        "${pi / 2}": "1.5707963267948966",
        "${min($speed, 3) + max(1, 2) * sign(-4)}": "1.0",
        "${not $wet or 3 > 2}": "true",
        "${$side == 'left'}": "true",
    }.items(),
)
def test_values_are_computed(text: str, expected: str) -> None:
    assert substitute(text, PARAMETERS) == expected


@pytest.mark.parametrize(
    "text",
    [
        "$slow",
        "${$slow + 1}",
        "${1 / 0}",
        "${2 ** 3}",
        "${__import__('os')}",
        "${(1).real}",
        "${[1]}",
        "${1 +}",
        "${" + "1+" * MAX_EXPRESSION_LENGTH + "1}",
        "${" + "(" * 400 + "}",
        "${sqrt(-1)}",
        "${pow(9e300, 9)}",
    ],
)
def test_all_else_is_an_error(text: str) -> None:
    with pytest.raises(
        ValueError, match=r"no value|unknown|not know|cannot be evaluated|characters|domain"
    ):
        substitute(text, PARAMETERS)
