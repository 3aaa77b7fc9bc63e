"""What a spec asks of a machine, whatever the machine."""

from dataclasses import dataclass

from advercity_dsl import Spec


@dataclass(frozen=True)
class Workload:
    """Of one frame.

    Attributes:
        agents: Viewpoints.
        pictures: Of all cameras; each comes with its classes and depths.
        pixels: Of all those pictures.
        beams: Of all LiDARs.
    """

    agents: int
    pictures: int
    pixels: int
    beams: int

    @staticmethod
    def of(spec: Spec, scale: float) -> "Workload":
        """Of a frame of `spec` with pictures at `scale` of their authored width and height."""
        cameras = [agent.sensors.camera for agent in spec.agents]
        lidars = [agent.sensors.lidar for agent in spec.agents]
        return Workload(
            agents=len(spec.agents),
            pictures=sum(len(camera.mounts) for camera in cameras),
            pixels=round(
                sum(
                    len(camera.mounts) * camera.width_px * camera.height_px * scale**2
                    for camera in cameras
                )
            ),
            beams=sum(lidar.channels * lidar.azimuths * lidar.sub_rays for lidar in lidars),
        )
