import pytest
from advercity_dsl.units import KM_H_PER_M_S, UNITS, Unit


@pytest.mark.parametrize(
    ("unit", "text", "number"),
    [
        ("m", "0.1 km", 100.0),
        ("m", "75 m", 75.0),
        ("m", " .5cm ", 0.005),
        ("m/s", "36 km/h", 10.0),
        ("km/h", "10 m/s", 36.0),
        ("1", "40 %", 0.4),
        ("%", "40 %", 40.0),
        ("m", "300 ft", 91.44),
        ("mm", "12 in", 304.8),
        ("m", "0.5 mi", 804.672),
        ("mm/h", "0.5 in/h", 12.7),
        ("degC", "41 degF", 5.0),
        ("degC", "-40 degF", -40.0),
        ("degC", "212 degF", 100.0),
        ("deg", "3.14159265358979 rad", 180.0),
        ("m", "inf m", float("inf")),
    ],
)
def test_quantities_are_converted_to_the_unit_of_the_field(
    unit: str, text: str, number: float
) -> None:
    assert Unit(unit).parse(text) == pytest.approx(number, abs=1e-12)


@pytest.mark.parametrize("value", [75, 0.5, None, True, [1]])
def test_values_that_are_not_text_are_unchanged(value: object) -> None:
    assert Unit("m").parse(value) is value


@pytest.mark.parametrize(
    ("unit", "text", "message"),
    [
        ("m", "2,5 m", "has a comma; write a point, as in 2.5 m"),
        ("m", "\u0663 m", "is not a length; write e.g. 10 m"),
        ("m", "thick", "'thick' is not a length; write e.g. 10 m"),
        ("m", "75", "'75' is text; remove the quotes, or add a unit: 10 m"),
        ("m", "75 s", "'s' is a unit of time; units of length: um, mm, cm, m, km, in, ft, mi"),
        ("m", "3 parsecs", "'parsecs' is not a known unit"),
        ("1", "0.5 1", "'1' is not a known unit; units of fraction: %"),
    ],
)
def test_text_that_is_not_a_quantity_of_the_dimension_is_rejected(
    unit: str, text: str, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        Unit(unit).parse(text)


def test_every_dimension_has_a_unit_of_size_one() -> None:
    assert {UNITS[name][0] for name in UNITS} == {
        kind for kind, size in UNITS.values() if size == 1
    }


def test_speeds_agree_with_the_factor() -> None:
    assert Unit("km/h").parse("1 m/s") == KM_H_PER_M_S
