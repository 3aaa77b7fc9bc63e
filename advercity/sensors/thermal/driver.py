"""Takes the images of the thermal cameras of an open scenario."""

from functools import lru_cache

from advercity_dsl import Agent, ThermalCamera

from advercity.sensors.annotation import project_boxes
from advercity.sensors.camera_model import CameraModel
from advercity.sensors.sensor_frame import ThermalImage
from advercity.sensors.stage import SensorDriver, Stage, list_carrier_ids
from advercity.sensors.thermal.conditions import ThermalConditions, derive_thermal_conditions
from advercity.sensors.thermal.image import cast_thermal, take_thermal_image


class ThermalDriver(SensorDriver):
    """Measures with thermal cameras."""

    def __init__(self, stage: Stage) -> None:
        super().__init__(stage)
        self._derive_once = lru_cache(maxsize=1)(self._derive_conditions)

    def measure(self, agent: Agent, number: int) -> ThermalImage:
        """Take an image."""
        stage, hide = self.stage, list_carrier_ids(agent)
        camera = agent.sensors.thermals[number].model
        frame = stage.find_sampled_frame("thermal", agent, number)
        pose = stage.poses.world_from_sensors("thermal", agent, frame)[number]
        conditions = self._derive_once(stage.weather_state)
        model = build_thermal_model(camera, stage.profile.scale)
        view = cast_thermal(model, pose, frame, stage.raycaster, conditions, hide=hide)
        counts = take_thermal_image(
            camera,
            view,
            conditions,
            frame.states,
            stage.poses.make_generator("thermal", agent, frame, number),
            seed=stage.spec.seeds.sensors,
            name=f"{agent.id} {number}",
        )
        boxes = project_boxes(view.instance, pose, model, frame, stage.find_hull_points, hide=hide)
        stamp_s = stage.find_stamp("thermal", agent, number)
        return ThermalImage(pose, counts, view.semantic, view.instance, boxes, stamp_s)

    def _derive_conditions(self, state: int) -> ThermalConditions:
        weather = self.stage.poses.timeline.weather_at(state)
        return derive_thermal_conditions(self.stage.atmosphere, weather)


def build_thermal_model(camera: ThermalCamera, scale: float) -> CameraModel:
    """Build the projection of a thermal camera to an image at a scale."""
    width_px, height_px = (
        max(1, round(side * scale)) for side in (camera.width_px, camera.height_px)
    )
    return CameraModel.build_pinhole(camera.horizontal_fov_deg, width_px, height_px)
