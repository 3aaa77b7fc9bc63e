from pathlib import Path
from typing import Any

import pytest
from advercity_dsl import Suite, Typology
from advercity_dsl.suite import Coverage, Selection
from hypothesis import given
from hypothesis import strategies as st

from advercity.compiler import find_shipped_library, load_library, validate_paths
from advercity.compiler.suites import find_required_categories, is_selected
from advercity.errors import InputError
from tests.builders import SMALL_LIBRARY, Write, describe_errors


def test_the_rule_selects_the_four_groups_of_the_paper(library: Path) -> None:
    typologies = load_library(library).get_declarations(Typology).values()
    selected = {item.id for item in typologies if is_selected(item, Selection())}
    assert selected == {"pedestrian", "pedalcyclist", "opposite_direction", "crossing_paths"}


@pytest.mark.parametrize(
    "rule",
    [
        Selection(fatality_rate_percent=0.13),
        Selection(fatality_rate_percent=0.35),
        Selection(bad_visibility_percent=2.01),
        Selection(bad_visibility_percent=4),
        Selection(vehicles_per_crash=1.17),
        Selection(vehicles_per_crash=1.88),
    ],
)
def test_the_selection_is_robust_against_its_thresholds(library: Path, rule: Selection) -> None:
    typologies = load_library(library).get_declarations(Typology).values()
    assert sum(is_selected(item, rule) for item in typologies) == 4


def test_road_departure_would_be_selected_without_the_partner_rule(library: Path) -> None:
    departure = load_library(library).get_declarations(Typology)["road_departure"]
    rule = Selection(vehicles_per_crash=1.0, bad_visibility_percent=2)
    assert is_selected(departure, rule)
    assert not is_selected(departure, Selection(bad_visibility_percent=2))


def test_required_kinds_of_roads_are_those_of_the_paper(library: Path) -> None:
    typologies = load_library(library).get_declarations(Typology)
    cells = {
        name: sorted(str(cell) for cell in find_required_categories(typologies[name], Coverage()))
        for name in ("pedestrian", "pedalcyclist", "opposite_direction", "crossing_paths")
    }
    assert cells == {
        "pedestrian": ["urban intersection", "urban non_junction"],
        "pedalcyclist": ["rural intersection", "urban intersection"],
        "opposite_direction": ["rural non_junction curved", "rural non_junction straight"],
        "crossing_paths": ["rural intersection", "urban intersection"],
    }


FIGURE = st.integers(1, 3)
"""As few values that a figure often equals its threshold."""


@pytest.fixture(scope="module")
def pedestrian(library: Path) -> dict[str, Any]:
    """The fields of the group of crashes with pedestrians."""
    return load_library(library).get_declarations(Typology)["pedestrian"].model_dump()


def vary(known: dict[str, Any], **parts: dict[str, Any]) -> Typology:
    """Change figures of a group."""
    return Typology.model_validate(known | {key: known[key] | part for key, part in parts.items()})


@given(figures=st.tuples(FIGURE, FIGURE, FIGURE), least=st.tuples(FIGURE, FIGURE, FIGURE))
@pytest.mark.parametrize("external_entity", [True, False])
def test_a_group_is_selected_if_its_figures_reach_all_thresholds(
    pedestrian: dict[str, Any],
    external_entity: bool,
    figures: tuple[int, int, int],
    least: tuple[int, int, int],
) -> None:
    names = ("vehicles_per_crash", "fatality_rate_percent", "bad_visibility_percent")
    statistics = {"external_entity": external_entity, **dict(zip(names, figures, strict=True))}
    group = vary(pedestrian, statistics=statistics)
    rule = Selection.model_validate(dict(zip(names, least, strict=True)))

    partner, *others = (one >= limit for one, limit in zip(figures, least, strict=True))
    assert is_selected(group, rule) == ((external_entity or partner) and all(others))


@given(percent=st.tuples(*[FIGURE] * 6), least=st.tuples(FIGURE, FIGURE, FIGURE))
def test_roads_are_required_of_all_features_that_reach_their_thresholds(
    pedestrian: dict[str, Any], percent: tuple[int, ...], least: tuple[int, int, int]
) -> None:
    urban, rural, intersection, non_junction, non_level, curved = percent
    uses = {"urban": urban, "rural": rural}
    places = {"intersection": intersection, "non_junction": non_junction}
    shape = {"non_level": non_level, "curved": curved}
    roads: dict[str, Any] = {f"{name}_percent": value for name, value in (uses | shape).items()}
    roads["junctions"] = [{"junction": name, "percent": places[name]} for name in places]
    group = vary(pedestrian, roads=roads)
    land_use, junction, geometry = least
    rule = Coverage(land_use_percent=land_use, junction_percent=junction, geometry_percent=geometry)

    geometries = ("straight", "curved") if max(non_level, curved) >= geometry else (None,)
    expected = {
        (use, place, bend)
        for use in uses
        for place in places
        for bend in geometries
        if uses[use] >= land_use and places[place] >= junction
    }
    found = find_required_categories(group, rule)
    assert {(one.land_use, one.junction, one.geometry) for one in found} == expected
    assert len(found) == len(expected)


def test_an_unknown_name_is_reported_with_the_most_similar_one(write: Write) -> None:
    folder = write(suite="kind: suite\nid: small\nrig: one_camra\ncatalogue: one_car\n")
    assert describe_errors(folder) == (
        "suite.yaml:3:6: rig: unknown rig 'one_camra'; did you mean 'one_camera'?"
    )


def test_an_example_that_is_not_in_the_library_is_named(write: Write) -> None:
    folder = write(
        suite="kind: suite\nid: small\nweathers: [hail_day]\nrig: one_camera\ncatalogue: one_car\n",
    )
    hint = "an example has this name; copy {}/hail_day.yaml into the library"
    examples = find_shipped_library() / "examples"
    assert describe_errors(folder).endswith(hint.format(examples))
    child = write(child="kind: weather\nid: child\nextends: hail_day\ntime: day\n")
    assert hint.format(examples) in describe_errors(child)


@pytest.mark.parametrize(
    ("field", "kind"), [("rig", "rig"), ("catalogue", "catalogue"), ("drivers", "drivers")]
)
def test_all_is_an_id_where_a_suite_takes_one_declaration(
    write: Write, field: str, kind: str
) -> None:
    fields = {"rig": "one_camera", "catalogue": "one_car"} | {field: "all"}
    folder = write(
        suite="".join(
            [
                f"{key}: {value}\n"
                for key, value in {"kind": "suite", "id": "small", **fields}.items()
            ]
        )
    )
    assert f"unknown {kind} 'all'" in describe_errors(folder)


def test_a_road_needs_one_ego(write: Write) -> None:
    folder = write(
        road=(SMALL_LIBRARY / "road.yaml").read_text().replace("role: ego", "role: other")
    )
    assert describe_errors(folder) == (
        "road.yaml:19:3: agents: 0 agents have the role 'ego'; exactly one is required"
    )


def test_the_highest_beam_must_be_above_the_lowest(write: Write) -> None:
    road = (
        (SMALL_LIBRARY / "road.yaml")
        .read_text()
        .replace("pitch_deg: 10", "pitch_deg: 10, lidar_upper_deg: -30")
    )
    assert "lidar_upper_deg: -30 is not above the rig's lower_deg -25" in describe_errors(
        write(road=road)
    )
    rig = (
        (SMALL_LIBRARY / "rig.yaml")
        .read_text()
        .replace("lidar: {mount", "lidar: {upper_deg: -30, mount")
    )
    assert "upper_deg -30 is not above lower_deg -25" in describe_errors(write(rig=rig))


def test_a_suite_has_its_rules_in_the_library(library: Path) -> None:
    suite = load_library(library).get_declarations(Suite)["adver_city"]
    assert (suite.selection.fatality_rate_percent, suite.coverage.junction_percent) == (0.3, 50)


def test_unknown_names_of_all_suites_and_conflicts_are_reported_at_once(write: Write) -> None:
    folder = write(
        suite="kind: suite\nid: small\nweathers: [clear_dya, rain]\nrig: one_camra\n"
        "catalogue: one_car\nstage: {lan: [hit]}\n",
        other="kind: suite\nid: other\nrig: one_camera\ncatalogue: one_cat\n"
        "where: {weather.tme: day}\n",
        hook=(Path(__file__).parents[2] / "library/nhtsa/conflicts/cyc_right_hook.yaml")
        .read_text()
        .replace("stages: [", "stages: [nhtsa2019:98, "),
    )
    with pytest.raises(InputError) as caught:
        validate_paths(folder)
    text = str(caught.value)
    for name in ("clear_dya", "rain", "one_camra", "lan", "hit", "one_cat", "nhtsa2019:98"):
        assert f"'{name}'" in text
    assert "where.weather.tme: no such field; did you mean 'time'?" in text
