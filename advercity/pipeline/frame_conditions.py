"""What the sensors need of the weather in each frame."""

from dataclasses import dataclass
from functools import lru_cache

from advercity_dsl import Spec

from advercity.physics.atmosphere import Atmosphere
from advercity.physics.timeline import WeatherTimeline
from advercity.sensors.camera import CameraConditions, move_blocks
from advercity.sensors.lidar import LidarConditions, derive_lidar_conditions
from advercity.sensors.radar import RadarConditions, derive_radar_conditions
from advercity.sensors.thermal import ThermalConditions, derive_thermal_conditions


@dataclass(frozen=True, eq=False)
class FrameConditions:
    """Air and light of a frame, as the renderer and the sensors need them."""

    atmosphere: Atmosphere
    camera: CameraConditions
    lidar: LidarConditions
    radar: RadarConditions


class ConditionsByFrame:
    """The conditions of each frame of a scenario, in any order of frames.

    For a constant weather they are the same object for all frames.
    """

    def __init__(self, spec: Spec, timeline: WeatherTimeline) -> None:
        self._spec, self._timeline = spec, timeline
        sizes = timeline.list_sizes() if timeline.is_changing else None
        self._camera = CameraConditions.build(
            timeline.atmosphere_at(0, spec.road.land_use),
            timeline.weather_at(0).lens,
            *(spec.seeds.sensors, spec.id),
            all_sizes=sizes,
        )
        self._blocks = self._camera.blocks
        self._derive_once = lru_cache(maxsize=1)(self._derive)
        # Apart from the rest: most rigs have no thermal camera.
        self._derive_thermal_once = lru_cache(maxsize=1)(self._derive_thermal)

    def at(self, frame: int) -> FrameConditions:
        """Return the conditions of a recorded frame."""
        return self._derive_once(self._find_state(frame))

    def thermal_at(self, frame: int) -> ThermalConditions:
        """Return what thermal cameras need of a recorded frame."""
        return self._derive_thermal_once(self._find_state(frame))

    def _find_state(self, frame: int) -> int:
        return frame if self._timeline.is_changing else 0

    def _derive_thermal(self, frame: int) -> ThermalConditions:
        weather = self._timeline.weather_at(frame)
        return derive_thermal_conditions(self.at(frame).atmosphere, weather)

    def _derive(self, frame: int) -> FrameConditions:
        timeline, weather = self._timeline, self._timeline.weather_at(frame)
        lens = weather.lens
        atmosphere = timeline.atmosphere_at(frame, self._spec.road.land_use)
        if timeline.is_changing:
            time_s, path_m = frame * self._spec.timing.tick_s, timeline.compute_air_path_m(frame)
            blocks = move_blocks(self._blocks, atmosphere, path_m, time_s)
            self._camera = self._camera.change(atmosphere, lens, blocks)
        return FrameConditions(
            atmosphere=atmosphere,
            camera=self._camera,
            lidar=derive_lidar_conditions(atmosphere, lens, weather.fog),
            radar=derive_radar_conditions(atmosphere, lens, weather.fog),
        )
