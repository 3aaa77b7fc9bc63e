"""The weather in each frame for cameras."""

from functools import lru_cache

from advercity_dsl import Spec

from advercity.physics.timeline import WeatherTimeline
from advercity.sensors.camera.falling_particles import move_blocks
from advercity.sensors.camera.image_formation import CameraConditions


class CameraWeather:
    """The conditions of cameras in each frame of a scenario, in any order of frames.

    In a constant weather, all frames share one object.
    """

    def __init__(self, spec: Spec, timeline: WeatherTimeline) -> None:
        self._spec, self._timeline = spec, timeline
        self._conditions = CameraConditions.build(
            timeline.atmosphere_at(0, spec.road.land_use),
            timeline.weather_at(0).lens,
            *(spec.seeds.sensors, spec.id),
            all_moments=timeline.list_precipitation() if timeline.is_changing else None,
        )
        self._blocks = self._conditions.blocks
        self.at = lru_cache(maxsize=1)(self._derive)

    def _derive(self, frame: int) -> CameraConditions:
        """Derive the conditions of a recorded frame; unchanged light is kept."""
        timeline, land_use = self._timeline, self._spec.road.land_use
        if timeline.is_changing:
            atmosphere = timeline.atmosphere_at(frame, land_use)
            time_s, path_m = frame * self._spec.timing.tick_s, timeline.compute_air_path_m(frame)
            blocks = move_blocks(self._blocks, atmosphere, path_m, time_s)
            lens = timeline.weather_at(frame).lens
            self._conditions = self._conditions.change(atmosphere, lens, blocks)
        return self._conditions
