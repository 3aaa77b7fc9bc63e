from pathlib import Path

import pytest
from advercity_dsl import Suite, Typology
from advercity_dsl.suite import Coverage, Selection

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
