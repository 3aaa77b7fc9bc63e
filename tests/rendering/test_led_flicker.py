"""Light of switched lamps in an exposure, against the square waves that it is the integral of."""

from dataclasses import replace

import numpy as np
import pytest

from advercity.frames import Frame, Lamp, Signal
from advercity.rendering.lamp_lenses import LensKind, compute_lens_luminances
from advercity.rendering.led_flicker import (
    SIGNAL_DUTY,
    TAIL_DUTY,
    apply_led_flicker,
    compute_collected_ratio,
)
from advercity.rendering.light_sources import list_light_sources
from advercity.testing import build_flat_world, make_actor_state


@pytest.mark.parametrize("exposure_s", [1e-4, 2e-3, 1 / 100, 1 / 30])
@pytest.mark.parametrize(("frequency_hz", "duty"), [(100.0, 0.5), (237.0, 0.06)])
def test_an_exposure_collects_the_integral_of_the_wave(
    exposure_s: float, frequency_hz: float, duty: float
) -> None:
    for start_s in np.linspace(0.0, 0.05, 7).tolist():
        end_s, phase = start_s + exposure_s, 0.3
        found = compute_collected_ratio(
            start_s, end_s, frequency_hz=frequency_hz, duty=duty, phase=phase
        )
        time_s = start_s + exposure_s * (np.arange(200_000) + 0.5) / 200_000
        is_on = (time_s * frequency_hz + phase) % 1.0 < duty
        assert found == pytest.approx(is_on.mean() / duty, abs=2e-3)


def test_short_exposures_see_lamps_on_or_off_and_long_ones_their_mean() -> None:
    def collect(exposure_s: float) -> set[float]:
        return {
            round(
                compute_collected_ratio(
                    start_s, start_s + exposure_s, frequency_hz=120.0, duty=0.5, phase=0.0
                ),
                3,
            )
            for start_s in (0.0005, 0.003, 0.005, 0.0075)
        }

    assert collect(1e-4) == {0.0, 2.0}
    assert collect(1 / 120) == {1.0}
    assert all(0.97 <= ratio <= 1.03 for ratio in collect(0.2))


def lit_frame(time_s: float) -> Frame:
    """Two cars with tail lamps and one that brakes, and two signals."""
    states = tuple(
        replace(make_actor_state(number, 10.0 * number), lamps=lamps)
        for number, lamps in ((1, Lamp.LOW_BEAM), (2, Lamp.LOW_BEAM), (3, Lamp.BRAKE))
    )
    return Frame(0, time_s, states, {"a": Signal.RED, "b": Signal.GREEN})


def test_lamps_flicker_each_in_its_phase_about_their_mean() -> None:
    times_s = np.arange(4000) * 0.00137
    frames = [apply_led_flicker(lit_frame(float(time_s)), 5e-4, seed=4) for time_s in times_s]
    tails = np.array([[state.tail_light_ratio for state in frame.states] for frame in frames])
    signals = np.array([list(frame.signal_light_ratios.values()) for frame in frames])
    np.testing.assert_allclose(tails.mean(axis=0), 1.0, atol=0.1)
    np.testing.assert_allclose(signals.mean(axis=0), 1.0, atol=0.05)
    assert tails.min() == signals.min() == 0.0
    assert signals.max() == pytest.approx(1 / SIGNAL_DUTY)
    assert 3 < tails.max() <= 1 / TAIL_DUTY
    assert (tails[:, 0] != tails[:, 1]).any()
    again = apply_led_flicker(lit_frame(float(times_s[7])), 5e-4, seed=4)
    assert again.signal_light_ratios == frames[7].signal_light_ratios
    assert [state.tail_light_ratio for state in again.states] == tails[7].tolist()


def test_vehicles_have_frequencies_and_phases_of_their_own_whatever_the_seed() -> None:
    for seed in range(5):
        tails = np.array(
            [
                [
                    one.tail_light_ratio
                    for one in apply_led_flicker(lit_frame(t), 1e-4, seed=seed).states
                ]
                for t in (np.arange(600) * 0.00137).tolist()
            ]
        )
        # Of 600, a correlation of 0.25 is six standard deviations.
        np.testing.assert_allclose(np.corrcoef(tails.T), np.eye(3), atol=0.25)


def test_vehicles_begin_at_phases_of_their_own() -> None:
    states = tuple(
        replace(make_actor_state(number, 10.0 * number), lamps=Lamp.LOW_BEAM)
        for number in range(1, 201)
    )
    found = apply_led_flicker(Frame(0, 5e-5, states, {}), 1e-4, seed=3)
    lit = np.mean([one.tail_light_ratio > 0 for one in found.states])
    assert 0.3 * TAIL_DUTY < lit < 3 * TAIL_DUTY + 0.1


def test_signals_are_on_three_phases_of_the_mains() -> None:
    names = {str(number): Signal.RED for number in range(60)}
    found = apply_led_flicker(Frame(0, 0.0004, (), names), 1e-4, seed=1).signal_light_ratios
    times_s = (np.arange(50) * 0.00037).tolist()
    frames = [apply_led_flicker(Frame(0, t, (), names), 1e-4, seed=1) for t in times_s]
    courses = {
        tuple(round(frame.signal_light_ratios[name], 6) for frame in frames) for name in found
    }
    assert len(courses) == 3


def test_brake_lamps_do_not_flicker_and_tail_lamps_shine_as_they_are_collected() -> None:
    world = build_flat_world()
    tail, brake = Lamp.LOW_BEAM, Lamp.LOW_BEAM | Lamp.BRAKE
    for lamps, expected in ((tail, 3.0), (brake, 1.0)):
        state = replace(make_actor_state(1, 10.0), lamps=lamps)
        steady, bright, dark = (
            [
                lamp
                for lamp in list_light_sources(
                    world, Frame(0, 0.0, (replace(state, tail_light_ratio=ratio),), {})
                )
                if lamp.facing[0] < 0
            ]
            for ratio in (1.0, 3.0, 0.0)
        )
        assert bright[0].intensity_cd == pytest.approx(expected * steady[0].intensity_cd)
        assert bool(dark) == (lamps == brake)
        luminances = [compute_lens_luminances(lamps, light_ratio=ratio) for ratio in (1.0, 3.0)]
        red, white = LensKind.LAMP_RED, LensKind.LAMP_WHITE
        assert luminances[1][red] == pytest.approx(expected * luminances[0][red])
        assert luminances[1][white] == luminances[0][white]
