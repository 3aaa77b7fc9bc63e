import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from advercity.dataset.documents import plain


@given(st.floats(-1e6, 1e6), st.integers(0, 12))
def test_a_number_alone_is_rounded_like_one_of_many(number: float, decimals: int) -> None:
    alone, (among,) = plain(number, decimals=decimals), plain([number], decimals=decimals)
    assert (alone, math.copysign(1.0, alone)) == (among, math.copysign(1.0, among))


@pytest.mark.parametrize(
    ("number", "rounded"), [(0.12345678949, 0.123456789), (-1e-12, 0.0), (2.5e-9, 2e-9)]
)
def test_nine_decimals_are_kept(number: float, rounded: float) -> None:
    assert str(plain(number)) == str(rounded)
