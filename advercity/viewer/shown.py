"""A viewer's data of a measurement, in plain arrays: kinds of sensors need not know Rerun."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from numpy.typing import ArrayLike

from advercity.geometry.arrays import Float64Array, Uint8Array
from advercity.geometry.poses import Matrix
from advercity.run_options import CloudColour
from advercity.sensors.camera_model import CameraModel
from advercity.sensors.sensor_frame import SensorFrame


@dataclass(frozen=True, eq=False)
class Picture:
    """An image with a view of its own.

    Attributes:
        sensor: Name of the sensor, unique in its agent: `camera0`.
        title: Title of the view.
        pixels: (h, w, 3) RGB.
        pose: (4, 4) in the world, body axes, of an image also shown in the scene.
        model: Its projection; with a pose only.
        group: Beginning of the path of an image outside the scene.
        is_label: Whether its colours are labels, which must not be compressed with losses.
    """

    sensor: str
    title: str
    pixels: Uint8Array
    pose: Matrix | None = None
    model: CameraModel | None = None
    group: str = "world"
    is_label: bool = False


@dataclass(frozen=True, eq=False)
class Points:
    """Points in the scene.

    Attributes:
        sensor: Name of the sensor, unique in its agent: `radar0`.
        points: (n, 3) metres in the sensor's frame.
        pose: (4, 4) of the sensor in the world.
        colours: (n, 3) RGB, or one of all.
        sizes_px: (n,) on the screen, or one of all.
    """

    sensor: str
    points: ArrayLike
    pose: Matrix
    colours: ArrayLike
    sizes_px: ArrayLike


@dataclass(frozen=True, eq=False)
class Curve:
    """A value over time.

    Attributes:
        quantity: Title of the plot, in which every agent has a curve.
        value: In this frame; several are curves of their own.
        axes: Their names.
    """

    quantity: str
    value: float | Float64Array
    axes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Place:
    """A place on the map."""

    latitude_deg: float
    longitude_deg: float


Shown = Picture | Points | Curve | Place
ShowFunction = Callable[[SensorFrame, int, CloudColour], Sequence[Shown]]
"""Lists the shown data of the measurement with a number, with points of clouds in a colouring."""
