"""A frame of a compiled scenario, ready to render or to scan."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from advercity_dsl import Agent

from advercity.compiler import read_spec
from advercity.frames import Frame
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import transform_points
from advercity.physics.atmosphere import compute_atmosphere
from advercity.pipeline.preparation import load_or_build_world, load_or_simulate_traffic
from advercity.rendering.backend import CameraView, RenderProfile
from advercity.sensors.agent_poses import AgentPoses
from advercity.sensors.camera.driver import build_camera_view


class BenchmarkScene:
    """World, air and traffic of a scenario at one frame; traffic and world come from the cache.

    Attributes:
        spec: The scenario.
        trace: Its traffic.
        length: Number of its frames.
        poses: Poses of its agents.
        frame: The frame.
        world: Its world.
        air: The atmosphere of its own weather.
        ego: Its first agent.
    """

    def __init__(self, spec_path: Path, frame_index: int) -> None:
        self.spec = read_spec(spec_path)
        traffic = load_or_simulate_traffic(self.spec)
        self.trace, self.length = traffic.trace, len(traffic.trace)
        self.poses = AgentPoses(self.spec, traffic.trace)
        self.frame = self.poses.load_frame(frame_index)
        self.world = load_or_build_world(self.spec, traffic.network_path)
        self.air = compute_atmosphere(self.spec.weather, self.spec.road.land_use)
        self.ego = self.spec.agents[0]

    def list_views(self, agent: Agent, profile: RenderProfile) -> list[CameraView]:
        """List the views of an agent's cameras."""
        return [
            build_camera_view(agent, number, pose, profile)
            for number, pose in enumerate(
                self.poses.world_from_sensors("camera", agent, self.frame)
            )
        ]

    def list_world_meshes(self, frame: Frame) -> list[Mesh]:
        """List all meshes of a frame in world coordinates, vertices in float32."""
        placed = [(mesh, np.eye(4)) for mesh in self.world.static]
        for state in frame.states:
            parts = self.world.bodies[state.actor.blueprint].parts
            placed += [(mesh, state.world_from_body) for mesh in parts]
        return [
            replace(mesh, vertices=transform_points(pose, mesh.vertices).astype(np.float32))
            for mesh, pose in placed
        ]
