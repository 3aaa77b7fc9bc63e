"""Rooms behind panes: what coordinates of panes tell."""

import numpy as np

from advercity.scene.rooms import CURTAINS, NO_COVER, ROOM_NUMBERS, code_panes


def test_each_corner_of_a_pane_tells_its_room_and_cover_and_where_it_is() -> None:
    numbers, covers = np.array([0, ROOM_NUMBERS - 1]), np.array([NO_COVER, CURTAINS])
    coded = code_panes(numbers, covers).astype(np.float32).reshape(2, 4, 2)
    whole = np.floor(coded)
    np.testing.assert_array_equal(whole[..., 0], numbers[:, None] + np.zeros(4))
    np.testing.assert_array_equal(whole[..., 1], covers[:, None] + np.zeros(4))
    place = 2 * (coded - whole) - 0.5
    np.testing.assert_allclose(place[0], [(0, 0), (1, 0), (1, 1), (0, 1)], atol=1e-5)
    np.testing.assert_allclose(place[1], place[0], atol=1e-5)
