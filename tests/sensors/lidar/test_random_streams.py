"""Random numbers of a scan: one stream a purpose, whose place decides the bytes of datasets."""

import itertools
from statistics import NormalDist

import numpy as np

from advercity.randomness import create_generator
from advercity.sensors.lidar.random_streams import RandomStreams, StreamPurpose

PLACES = {
    **{"FIRED": 0, "SURFACE_NOISE": 1, "RANGE_NOISE": 2, "DROPOFF": 3, "SOFT_POWER": 4},
    **{"RAIN": 5, "SNOW": 6, "SPRAY": 8, "ONWARD_NOISE": 9, "SOFT_NOISE": 10},
    **{"SOFT_RANGE": 11, "SOFT_KIND": 12, "HAIL": 13, "STRAY_NOISE": 14},
}


def open_streams() -> RandomStreams:
    return RandomStreams(create_generator("test", 4))


def test_a_purpose_keeps_its_place_among_the_jumps_of_the_generator() -> None:
    """Else every dataset changes; a new purpose goes to the end."""
    assert {purpose.name: purpose.value for purpose in StreamPurpose} == PLACES
    root = create_generator("test", 4).bit_generator
    assert isinstance(root, np.random.Philox)
    for purpose in StreamPurpose:
        expected = np.random.Generator(root.jumped(PLACES[purpose.name] + 1)).random(4)
        np.testing.assert_array_equal(open_streams().open_stream(purpose).random(4), expected)


def test_streams_are_independent_and_start_again_at_their_beginning() -> None:
    streams, other = open_streams(), open_streams()
    drawn = {purpose: streams.normal(purpose, 20_000) for purpose in StreamPurpose}
    for purpose, numbers in reversed(drawn.items()):
        np.testing.assert_array_equal(other.normal(purpose, 20_000), numbers)
    for first, second in itertools.combinations(drawn.values(), 2):
        assert abs(np.corrcoef(first, second)[0, 1]) < 0.04


def test_numbers_are_quantiles_of_sixteen_bits() -> None:
    """The least is half a step from 0, where the normal distribution has 4.33 sigma."""
    uniform = open_streams().uniform(StreamPurpose.RAIN, 400_000)
    normal = open_streams().normal(StreamPurpose.RAIN, 400_000)
    assert uniform.min() == 0.5 / 65536
    assert uniform.max() == 1 - 0.5 / 65536
    assert normal.max() == -normal.min() == np.float32(NormalDist().inv_cdf(1 - 0.5 / 65536))
    np.testing.assert_allclose([normal.mean(), normal.std()], [0, 1], atol=5e-3)
    np.testing.assert_array_equal(np.argsort(normal[:1000]), np.argsort(uniform[:1000]))
