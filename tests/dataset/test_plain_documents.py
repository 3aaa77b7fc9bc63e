import math

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from advercity.dataset.plain_documents import format_yaml, to_plain


@given(st.floats(-1e6, 1e6), st.integers(0, 12))
def test_a_number_alone_is_rounded_like_one_of_many(number: float, decimals: int) -> None:
    alone, (among,) = to_plain(number, decimals=decimals), to_plain([number], decimals=decimals)
    assert (alone, math.copysign(1.0, alone)) == (among, math.copysign(1.0, among))


@pytest.mark.parametrize(
    ("number", "rounded"), [(0.12345678949, 0.123456789), (-1e-12, 0.0), (2.5e-9, 2e-9)]
)
def test_nine_decimals_are_kept(number: float, rounded: float) -> None:
    assert str(to_plain(number)) == str(rounded)


texts = st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), max_size=300)
scalars = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | texts
documents = st.dictionaries(
    st.integers(0, 10**6) | st.text("abc_", min_size=1, max_size=20),
    st.recursive(
        scalars,
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text("xyz"), inner),
        max_leaves=20,
    ),
)


@given(documents)
def test_pyyaml_reads_what_was_written(document: dict[object, object]) -> None:
    assert yaml.safe_load(format_yaml(document)) == document


def test_lists_and_mappings_of_scalars_are_on_one_line() -> None:
    document = {"pose": (1.0, -2.5), "gnss": {"lat": 1e-7}, "rows": [[1.0], [2.0]], 7: {"a": [[]]}}
    assert format_yaml(document).decode().splitlines() == [
        *("pose: [1.0, -2.5]", "gnss: {lat: 1.0e-07}", "rows:", "- [1.0]", "- [2.0]"),
        *("7:", "  a:", "  - []"),
    ]
