"""Text on bodies, signs and shops."""

from string import ascii_uppercase, digits

import numpy as np
import pytest
from numpy.typing import NDArray

from advercity.assets.glyphs import CHARACTERS, STROKE, build_glyph
from advercity.assets.lettering import LIFT_M, WritingPlane, fit_height, measure_text, write_text
from advercity.geometry.mesh import TriangleSurface

TOWARDS_X = WritingPlane((2.0, 0.0, 0.5), (0.0, 1.0, 0.0))


def is_inked(surface: TriangleSurface, x: float, y: float) -> bool:
    """Whether a point of the plane of a glyph is in one of its triangles."""
    a, b, c = (surface.vertices[surface.triangles[:, k], :2] for k in range(3))

    def is_left(start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.bool_]:
        run, to = end - start, np.array([x, y]) - start
        return run[:, 0] * to[:, 1] - run[:, 1] * to[:, 0] >= 0.0

    return bool((is_left(a, b) & is_left(b, c) & is_left(c, a)).any())


def draw(character: str, rows: int = 5, columns: int = 3) -> str:
    """A glyph as a display of few dots, from its top."""
    glyph = build_glyph(character)
    assert glyph.surface is not None
    x = np.linspace(STROKE / 2, glyph.width - STROKE / 2, columns)
    y = np.linspace(1.0 - STROKE / 2, STROKE / 2, rows)
    lines = ["".join("#" if is_inked(glyph.surface, at, up) else "." for at in x) for up in y]
    return " ".join(lines)


@pytest.mark.parametrize(
    ("character", "dots"),
    [
        ("E", "### #.. ##. #.. ###"),
        ("H", "#.# #.# ### #.# #.#"),
        ("L", "#.. #.. #.. #.. ###"),
        ("T", "### .#. .#. .#. .#."),
        ("U", "#.# #.# #.# #.# .#."),
        ("0", ".#. #.# #.# #.# .#."),
        ("7", "### ..# .#. .#. .#."),
    ],
)
def test_letters_look_as_on_a_display_of_dots(character: str, dots: str) -> None:
    assert draw(character) == dots


def test_all_letters_and_digits_exist_and_no_two_look_alike() -> None:
    assert frozenset(ascii_uppercase + digits + " ") == CHARACTERS
    # On road signs, too, zero is the letter O.
    assert len({draw(one, 24, 16) for one in CHARACTERS - {" ", "0"}}) == 35


@pytest.mark.parametrize("character", sorted(CHARACTERS - {" "}))
def test_letters_are_one_high_and_fit_between_their_edges(character: str) -> None:
    glyph = build_glyph(character)
    assert glyph.surface is not None
    low, high = glyph.surface.vertices.min(axis=0), glyph.surface.vertices.max(axis=0)
    assert (low[1], high[1]) == pytest.approx((0.0, 1.0), abs=2e-3)
    # Oblique strokes and the hook of Q end a little outside.
    assert low[0] > -STROKE / 2 and high[0] < glyph.width + STROKE / 2


def test_text_is_centred_and_read_by_who_stands_before_it() -> None:
    text = write_text("L1", TOWARDS_X, 0.1)
    low, high = text.vertices.min(axis=0), text.vertices.max(axis=0)
    length_m = measure_text("L1", 0.1)
    assert (low[1], high[1]) == pytest.approx((-length_m / 2, length_m / 2), abs=1e-3)
    assert (low[2], high[2]) == pytest.approx((0.45, 0.55))
    # The foot of L is on the left of a reader who looks along -x, who has +y on the right.
    middles = text.vertices[text.triangles].mean(axis=1)
    assert middles[:, 1].min() < -0.02
    np.testing.assert_allclose(text.vertices[:, 0], 2.0 + LIFT_M)
    assert text.normals is not None
    np.testing.assert_allclose(text.normals, np.tile([1.0, 0, 0], (len(text.normals), 1)))
    a, b, c = (text.vertices[text.triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 0] > 0.0).all()


def test_long_texts_are_written_smaller_until_they_fit() -> None:
    assert fit_height("CAFE", 0.3, 4.0) == 0.3
    height_m = fit_height("PHARMACY", 0.3, 1.0)
    assert measure_text("PHARMACY", height_m) == pytest.approx(1.0)
    assert measure_text("A A", 1.0) > measure_text("AA", 1.0)
