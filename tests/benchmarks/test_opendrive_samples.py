"""The sampler of OpenDRIVE maps, against numbers from tables and from paper."""

import math
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from opendrive_samples import LaneSamples, OpenDriveMap

LANE = '<lane id="{id}" type="driving" {more}><width sOffset="0" a="{width}"/>{inside}</lane>'
LINE = '<geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry>'


def near(expected: Any, abs: float = 1e-4) -> Any:
    """Lanes are sampled to a hundredth of a millimetre from their ends."""
    return pytest.approx(expected, abs=abs)


def lane(number: int, width: float = 3.5, inside: str = "", more: str = "") -> str:
    return LANE.format(id=number, width=width, inside=inside, more=more)


def sample(
    number: int,
    *,
    geometry: str = LINE,
    length: float = 100,
    left: str = "",
    right: str = "",
    profiles: str = "",
    offset: str = "",
    rule: str = "RHT",
    step_m: float = 1.0,
) -> LaneSamples:
    """Sample a lane of a map of one road."""
    text = (
        f'<OpenDRIVE><road id="1" length="{length}" junction="-1" rule="{rule}">'
        f"<planView>{geometry}</planView>{profiles}<lanes>{offset}<laneSection s='0'>"
        f"<left>{left}</left><right>{right}</right></laneSection></lanes></road></OpenDRIVE>"
    )
    opendrive = OpenDriveMap(ElementTree.fromstring(text))
    return opendrive.sections["1"][0].sample(number, step_m)


def reference_end(shape: str, length: float, place: str = 'x="0" y="0" hdg="0"') -> list[float]:
    """Compute the end of a reference line: the middle of a lane without width."""
    geometry = f'<geometry s="0" {place} length="{length}">{shape}</geometry>'
    found = sample(-1, geometry=geometry, length=length, right=lane(-1, width=0))
    return [*found.centre[-1, :2].tolist(), float(found.heading[-1])]


def test_a_quarter_arc_ends_a_radius_ahead_and_aside() -> None:
    length = 40 * math.pi / 2
    assert reference_end('<arc curvature="0.025"/>', length) == near(
        [40, 40, math.pi / 2], abs=2e-4
    )
    # From (10, 20) northwards and to the right: 40 m on and 40 m to the east.
    assert reference_end(
        '<arc curvature="-0.025"/>', length, 'x="10" y="20" hdg="1.5707963267948966"'
    ) == near([50, 60, 0], abs=2e-4)


def test_a_clothoid_has_the_coordinates_of_fresnel_integrals() -> None:
    """With curvature pi s, the end at s is C(s), S(s); C(1) and S(1) are tabulated."""
    for scale in (1.0, 100.0):
        shape = f'<spiral curvStart="0" curvEnd="{math.pi / scale}"/>'
        end = reference_end(shape, scale)
        assert end[:2] == near([0.7798934 * scale, 0.4382591 * scale])
        assert end[2] == near(math.pi / 2, abs=0.04 / scale)


def test_a_clothoid_that_unwinds_is_one_that_winds_backwards() -> None:
    x, y, heading = reference_end('<spiral curvStart="0.05" curvEnd="0"/>', 20)
    # Heading 0.05 * 20 / 2; back from the end the same clothoid winds up to the right.
    assert heading == near(0.5, abs=1e-3)
    back_x, back_y, _ = reference_end('<spiral curvStart="0" curvEnd="0.05"/>', 20)
    cos, sin = math.cos(0.5), math.sin(0.5)
    assert [x, y] == near([cos * back_x + sin * back_y, sin * back_x - cos * back_y])


def test_a_cubic_is_followed_by_its_length() -> None:
    """The line v = 3/4 u is 1.25 m long for each metre of u."""
    assert reference_end('<poly3 a="0" b="0.75" c="0" d="0"/>', 50) == near(
        [40, 30, math.atan(0.75)], abs=1e-3
    )


@pytest.mark.parametrize(
    ("p_range", "length", "coefficients"),
    [
        ("normalized", 25.0, 'aU="0" bU="20" cU="0" dU="0" aV="1" bV="0" cV="0" dV="8"'),
        ("arcLength", 25.0, 'aU="0" bU="0.8" cU="0" dU="0" aV="1" bV="0" cV="0" dV="0.000512"'),
    ],
)
def test_a_parametric_cubic_knows_both_ranges(
    p_range: str, length: float, coefficients: str
) -> None:
    end = reference_end(f'<paramPoly3 pRange="{p_range}" {coefficients}/>', length)
    # u = 20, v = 1 + 8; slope of v over u 24 / 20.
    assert end == near([20, 9, math.atan2(24, 20)], abs=2e-3)


def test_lanes_lie_beside_each_other_and_lead_both_ways() -> None:
    right, left = lane(-1) + lane(-2, width=2), lane(1, width=3)
    outer = sample(-2, left=left, right=right)
    opposite = sample(1, left=left, right=right)
    assert outer.centre[[0, -1]] == near(np.array([[0, -4.5, 0], [100, -4.5, 0]]))
    assert outer.width_m == near(2)
    assert opposite.centre[[0, -1]] == near(np.array([[100, 1.5, 0], [0, 1.5, 0]]))
    assert np.abs(opposite.heading) == near(math.pi)


def test_on_the_left_the_left_lane_leads_on() -> None:
    found = sample(1, left=lane(1), right=lane(-1), rule="LHT")
    assert found.centre[[0, -1], 0] == near([0, 100])
    reverse = sample(-1, left=lane(1), right=lane(-1, more='direction="reversed"'))
    assert reverse.centre[[0, -1], 0] == near([100, 0])


def test_an_offset_moves_all_lanes_and_turns_them() -> None:
    """A lane offset of 0.1 s, from s = 50 on."""
    offset = '<laneOffset s="0" a="0"/><laneOffset s="50" a="0" b="0.1"/>'
    found = sample(-1, right=lane(-1), offset=offset)
    assert found.centre[30] == near([30, -1.75, 0])
    assert found.centre[90] == near([90, 2.25, 0])
    assert found.heading[90] == near(math.atan(0.1))


def test_superelevation_lowers_the_right_side() -> None:
    """5 % at t = -3.5, the middle of a lane 7 m wide: 17.5 cm lower, and 4 mm nearer."""
    roll = math.atan(0.05)
    profiles = (
        '<elevationProfile><elevation s="0" a="10"/></elevationProfile><lateralProfile>'
        f'<superelevation s="0" a="{roll}" b="0" c="0" d="0"/></lateralProfile>'
    )
    right = lane(-1, width=7) + lane(-2, width=2, more='level="true"')
    found = sample(-1, right=right, profiles=profiles)
    assert found.centre[0] == near([0, -3.5 * math.cos(roll), 10 - 3.5 * math.sin(roll)])
    assert found.centre[0, 2] == near(9.825, abs=3e-4)
    assert found.width_m == near(7)
    beside = sample(-2, right=right, profiles=profiles)
    assert beside.centre[0, 2] == near(10 - 7 * math.sin(roll)), "a level lane"


def test_a_crown_falls_to_both_sides_and_changes_between_its_sections() -> None:
    """2 % to both sides at the start, level at s = 100."""
    shapes = (
        '<shape s="0" t="-8" a="-0.16" b="0.02"/><shape s="0" t="0" a="0" b="-0.02"/>'
        '<shape s="100" t="-8" a="0"/>'
    )
    profiles = f"<lateralProfile>{shapes}</lateralProfile>"
    right = sample(-1, right=lane(-1, width=5), left=lane(1, width=5), profiles=profiles)
    left = sample(1, right=lane(-1, width=5), left=lane(1, width=5), profiles=profiles)
    assert right.centre[[0, 50, 100], 2] == near([-0.05, -0.025, 0])
    assert left.centre[[100, 50, 0], 2] == near([-0.05, -0.025, 0])


def test_a_lane_ends_with_the_records_of_its_own_section() -> None:
    """The offset jumps where the second section begins, as road editors write it."""
    text = (
        '<OpenDRIVE><road id="1" length="100" junction="-1"><planView>'
        f'{LINE}</planView><lanes><laneOffset s="40" a="-10"/>'
        f'<laneSection s="0"><right>{lane(-1)}</right></laneSection>'
        f'<laneSection s="40"><left>{lane(1)}</left></laneSection></lanes></road></OpenDRIVE>'
    )
    first, second = OpenDriveMap(ElementTree.fromstring(text)).sections["1"]
    assert first.sample(-1, 1).centre[[0, -1]] == near(np.array([[0, -1.75, 0], [40, -1.75, 0]]))
    assert second.sample(1, 1).centre[[0, -1]] == near(np.array([[100, -8.25, 0], [40, -8.25, 0]]))


def test_heights_raise_lanes_from_where_they_are_declared() -> None:
    inside = '<height sOffset="10" inner="0.1" outer="0.2"/>'
    found = sample(-1, right=lane(-1, inside=inside))
    assert found.centre[[9, 11, 90], 2] == near([0, 0.15, 0.15])


def test_borders_are_distances_from_the_reference_line() -> None:
    right = (
        '<lane id="-1" type="driving"><border sOffset="0" a="3"/></lane>'
        '<lane id="-2" type="driving"><border sOffset="0" a="5" b="0.01"/></lane>'
    )
    found = sample(-2, right=right)
    assert found.width_m[[0, 100]] == near([2, 3], abs=1e-3)
    assert found.centre[0, 1] == near(-4)


def test_a_lane_has_its_own_limit_else_that_of_its_road() -> None:
    profiles = (
        '<type s="0" type="rural"><speed max="90" unit="km/h"/></type>'
        '<type s="40" type="town"><speed max="25" unit="mph"/></type>'
        '<type s="60" type="town"><speed max="no limit"/></type>'
    )
    own = '<speed sOffset="50" max="8"/>'
    right = lane(-1) + lane(-2, inside=own)
    outer, inner = (sample(number, right=right, profiles=profiles) for number in (-2, -1))
    assert inner.speed_limit_m_s[[0, 39, 41, 59]] == near([25, 25, 11.176, 11.176])
    assert np.isnan(inner.speed_limit_m_s[61:]).all()
    assert outer.speed_limit_m_s[[0, 49, 51, 99]] == near([25, 11.176, 8, 8])
