"""Weather that changes over time, as it is written."""

import pytest
from advercity_dsl import Weather
from pydantic import ValidationError


def weather(*keyframes: dict[str, object], **values: object) -> Weather:
    common = {"kind": "weather", "id": "mine", "time": "day", "keyframes": keyframes}
    return Weather.model_validate(common | values)


def test_fog_lifts_evenly_in_extinction():
    lifting = weather({"at_s": 10, "fog": {"mor_m": None}}, fog={"mor_m": 75})

    # Extinction falls to a half, a quarter and a tenth, so visibility grows to 2, 4 and 10 times.
    at = [lifting.at(time_s).fog.mor_m for time_s in (0, 5, 7.5, 9, 10, 60)]
    assert at == pytest.approx([75, 150, 300, 750, None, None])


def test_each_value_runs_between_the_keyframes_that_mention_it():
    shower = weather(
        {"at_s": 10, "rain": {"rate_mm_h": 0}},
        {"at_s": 15, "fog": {"mor_m": 500}},
        {"at_s": 20, "rain": {"rate_mm_h": 30}, "surface": {"wetness": 1}},
        {"at_s": 30, "rain": {"rate_mm_h": 0}},
        surface={"wetness": 0.2},
    )

    rates = [shower.at(time_s).rain.rate_mm_h for time_s in (5, 10, 15, 20, 25, 40)]
    assert rates == [0, 0, 15, 30, 15, 0]
    assert shower.at(5).surface.wetness == pytest.approx(0.4)
    assert shower.at(15).surface.wetness == pytest.approx(0.8)
    assert shower.at(30).surface.wetness == 1


def test_the_sun_moves_along_its_arc_and_ends_the_day():
    # Along a great circle through east and west: half of 120 degrees up from the horizon.
    noon = weather(
        {"at_s": 10, "sun": {"elevation_deg": 60, "azimuth_deg": 270}},
        sun={"elevation_deg": 0.5, "azimuth_deg": 90},
    )
    sun = noon.at(5).sun
    assert (sun.elevation_deg, sun.azimuth_deg) == pytest.approx((60.25, 90))

    dusk = weather({"at_s": 8, "sun": {"elevation_deg": -6}}, sun={"elevation_deg": 2})
    assert [dusk.at(time_s).time for time_s in (0, 3, 4.9, 5.1, 8)] == [
        *("day", "day", "day", "night", "night")
    ]


def test_the_wind_veers_the_shorter_way():
    veering = weather({"at_s": 10, "wind": {"from_deg": 10}}, wind={"from_deg": 350})

    assert veering.at(5).wind.from_deg % 360 == pytest.approx(0)


def test_what_is_no_number_changes_at_its_keyframe():
    later = weather({"at_s": 10, "lamps": {"fog": True}})

    assert [later.at(time_s).lamps.fog for time_s in (9.99, 10)] == [False, True]


def test_a_keyframe_keeps_to_what_was_written():
    lifting = weather({"at_s": 10, "fog": {"mor_m": None}, "rain": {"rate_mm_h": 3}})
    data = lifting.model_dump(mode="json")

    assert data["keyframes"] == [{"at_s": 10, "fog": {"mor_m": None}, "rain": {"rate_mm_h": 3}}]
    assert Weather.model_validate(data) == lifting
    assert "keyframes" not in weather().model_dump()


@pytest.mark.parametrize(
    ("keyframes", "values", "message"),
    [
        ([{"at_s": 5, "rain": {}}, {"at_s": 5, "rain": {"rate_mm_h": 1}}], {}, "changes nothing"),
        (
            [{"at_s": at_s, "rain": {"rate_mm_h": 1}} for at_s in (5, 5)],
            {},
            "keyframes.1.at_s: 5 s is not after the keyframe before, 5 s",
        ),
        (
            [{"at_s": 5, "snow": {"rate_mm_h": 1}}],
            {},
            "keyframes.0.temperature_c: at 5 s: it snows at 15 degC",
        ),
        (
            [{"at_s": 5, "sun": {"elevation_deg": 3}}],
            {"sun": {"in_view_of": "ego"}},
            "moves the sun, whose place in_view_of determines",
        ),
        ([{"at_s": 5, "sky": {"direct_lx": 3}}], {}, "a number at one moment and derived"),
    ],
)
def test_contradictions_name_the_keyframe(
    keyframes: list[dict[str, object]], values: dict[str, object], message: str
):
    with pytest.raises(ValidationError, match=message):
        weather(*keyframes, **values)
