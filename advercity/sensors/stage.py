"""The placed frame of an open scenario, with rays and renderer for its sensors."""

from typing import Any

from advercity_dsl import Agent, RoadsideUnit, Spec

from advercity.assets.body_pose import build_pose_box_fitter
from advercity.frames import Frame
from advercity.geometry.poses import Matrix
from advercity.physics.lamp_beams import LightSource
from advercity.rendering.backend import Renderer, RenderProfile
from advercity.rendering.light_sources import list_light_sources
from advercity.rendering.raycaster import Raycaster
from advercity.sensors.agent_poses import AgentPoses
from advercity.sensors.annotation import build_hull_point_lookup
from advercity.sensors.sample_times import SampleMoment
from advercity.world import World


class Stage:
    """The placed frame of an open scenario.

    Attributes:
        spec: The scenario.
        poses: Poses of its agents and their sensors.
        world: Its world.
        renderer: Renders its cameras.
        profile: Quality of rendering, and the scale of images.
        backend_name: Name of the renderer's backend.
        raycaster: Casts rays; `place_raycaster` places its actors.
        find_hull_points: Finds points on the hull of a state's body.
        frame: The placed frame.
        atmosphere: Air and light of the frame.
    """

    def __init__(
        self,
        poses: AgentPoses,
        world: World,
        renderer: Renderer,
        profile: RenderProfile,
        backend_name: str = "",
    ) -> None:
        self.spec: Spec = poses.spec
        self.poses, self.world, self.renderer = poses, world, renderer
        self.profile, self.backend_name = profile, backend_name
        self.raycaster = Raycaster(world)
        self.find_hull_points = build_hull_point_lookup(world.bodies)
        self.frame = Frame(0, 0.0, (), {})
        self.atmosphere = poses.timeline.atmosphere_at(0, self.spec.road.land_use)
        self._fit_boxes = build_pose_box_fitter(world.bodies)
        self._rendered_frame: Frame | None = None
        self._sampled_frames: dict[SampleMoment, Frame] = {}
        self._light_sources: dict[float, tuple[LightSource, ...]] = {}

    @property
    def weather_state(self) -> int:
        """Number of the weather; frames with the same number have the same weather."""
        return self.frame.index if self.poses.timeline.is_changing else 0

    def place(self, index: int) -> None:
        """Place weather and actors of recorded frame `index`."""
        before = self.atmosphere
        self.atmosphere = self.poses.timeline.atmosphere_at(index, self.spec.road.land_use)
        if self.atmosphere is not before:
            self.renderer.change_atmosphere(self.atmosphere)
            self._rendered_frame = None
        self.frame = self._fit_boxes(self.poses.load_frame(index))
        self.place_renderer(self.frame)
        self._sampled_frames, self._light_sources = {}, {}

    def place_renderer(self, frame: Frame) -> None:
        """Place the actors of a frame in the renderer."""
        if frame is not self._rendered_frame:
            self.renderer.place(frame)
            self._rendered_frame = frame

    def place_raycaster(
        self, frame: Frame, agent: Agent, *, previous_frame: Frame | None = None
    ) -> Raycaster:
        """Place the actors of a frame, except the agent, for rays of the agent's sensors.

        With `previous_frame`, rays may be cast at any time between the two.
        """
        hide = list_carrier_ids(agent)
        self.raycaster.place(frame, hide=hide, previous_frame=previous_frame)
        return self.raycaster

    def find_sampled_frame(self, kind: str, agent: Agent, number: int) -> Frame:
        """Find the moment of a sensor's newest sample: mostly the placed frame itself."""
        sensor = agent.sensors.list_sensors(kind)[number].model
        if sensor.rate_hz is None:
            return self.frame
        moment = self.poses.find_sample(agent, f"{kind}{number}", sensor, self.frame.index)
        if moment not in self._sampled_frames:
            frame = self.frame
            if moment.frame != frame.index:
                frame = self._fit_boxes(self.poses.load_frame(moment.frame))
            shifted = frame.advance(moment.shift_s) if moment.shift_s else frame
            self._sampled_frames[moment] = shifted
        return self._sampled_frames[moment]

    def find_stamp(self, kind: str, agent: Agent, number: int) -> float | None:
        """Find the time of a sensor's newest sample; None if it samples with every frame."""
        if agent.sensors.list_sensors(kind)[number].model.rate_hz is None:
            return None
        return self.find_sampled_frame(kind, agent, number).time_s

    def find_light_sources(self, frame: Frame) -> tuple[LightSource, ...]:
        """Find the lamps of the scene at a time; none by day."""
        if not self.atmosphere.night:
            return ()
        if frame.time_s not in self._light_sources:
            self._light_sources[frame.time_s] = tuple(list_light_sources(self.world, frame))
        return self._light_sources[frame.time_s]


class SensorDriver:
    """Measures with all sensors of a kind of an open scenario, in any order of frames.

    Args:
        stage: The scenario; a frame is placed before `prepare` and `measure` are called.
    """

    def __init__(self, stage: Stage) -> None:
        self.stage = stage

    def prepare(self) -> None:
        """Prepare a frame, before any sensor measures in it."""

    def measure(self, agent: Agent, number: int) -> Any | None:
        """Measure with a sensor of an agent; agents and numbers come in the order of the spec.

        A measurement of a sensor with a place has the attribute `time_s`, from `Stage.find_stamp`.
        """
        raise NotImplementedError

    def estimate_pose(self, agent: Agent) -> Matrix | None:
        """Estimate the pose (4, 4) of an agent after its measurements; None without an estimate."""
        return None


def list_carrier_ids(agent: Agent) -> frozenset[int]:
    """List the actor below an agent's sensors, which must be invisible to them."""
    return frozenset() if isinstance(agent.place, RoadsideUnit) else frozenset({agent.number})
