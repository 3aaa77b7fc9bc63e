"""Entity paths of a recording, and the blueprint of the viewer's window."""

from collections.abc import Iterable, Sequence

import rerun.blueprint as rrb
from advercity_dsl import Agent

from advercity.geometry import poses
from advercity.geometry.poses import Matrix
from advercity.viewer.shown import Curve, Picture, Points, Shown

TIMELINE = "frame"
ANNOTATED_ACTORS = "world/actors/seen"
OTHER_ACTORS = "world/actors/unseen"
ROAD = "world/road"
CONFLICTS = "world/conflicts"
EVENTS = "events"
MAP_ROAD = "map/road"
MOTION = ("speed", "acceleration", "turn_rate", "latitude", "longitude", "altitude")
"""Plots of every recording; a receiver may have no fix yet in the first frame."""
FRAMES_PER_S = 10
MAP_ZOOM = 17.0
EYE_BEHIND_M, EYE_ABOVE_M, EYE_AHEAD_M = 24.0, 14.0, 10.0
"""Start of the eye relative to the first agent, and the point ahead at the centre of its view."""


def format_agent_path(agent: Agent) -> str:
    """Return the path of an agent in the scene."""
    return f"world/{agent.id}"


def format_sensor_path(agent: Agent, shown: Picture | Points) -> str:
    """Return the path of a picture, or of points in the scene."""
    group = shown.group if isinstance(shown, Picture) else "world"
    return f"{group}/{agent.id}/{shown.sensor}"


def format_plot_path(quantity: str, agent: Agent) -> str:
    """Return the path of a curve over time."""
    return f"plots/{quantity}/{agent.id}"


def format_weather_path(quantity: str) -> str:
    """Return the path of a weather quantity, by its name with the unit at its end."""
    return f"weather/{quantity}"


def build_blueprint(
    agents: Sequence[Agent],
    shown: Sequence[Sequence[Shown]],
    world_from_first: Matrix,
    map_tiles: bool,
) -> rrb.Blueprint:
    """Build the window: the scene above map and conflicts, and tabs of cameras, agents, curves.

    Args:
        agents: All agents.
        shown: Shown data of each agent in the first frame.
        world_from_first: (4, 4) pose of the first agent.
        map_tiles: Whether the map has tiles.
    """
    pictures = [[one for one in its_own if isinstance(one, Picture)] for its_own in shown]
    front = rrb.Grid(
        *(
            _build_image_view(agent, its_own[0], agent.id)
            for agent, its_own in zip(agents, pictures, strict=True)
            if its_own
        ),
        name="front cameras",
    )
    curves = [one for its_own in shown for one in its_own if isinstance(one, Curve)]
    tabs = rrb.Tabs(
        front,
        *(
            rrb.Grid(
                *(_build_image_view(agent, one, one.title) for one in its_own),
                grid_columns=2,
                name=agent.id,
            )
            for agent, its_own in zip(agents, pictures, strict=True)
            if its_own
        ),
        _build_motion_plots(dict.fromkeys([*MOTION, *(one.quantity for one in curves)])),
        _build_weather_plots(),
        active_tab=0,
    )
    eye = _build_eye_controls(agents[0], world_from_first)
    scene = rrb.Spatial3DView(origin="/world", name="scene", eye_controls=eye)
    below = rrb.Horizontal(
        rrb.MapView(origin="/map", name="receivers", zoom=MAP_ZOOM)
        if map_tiles
        else rrb.Spatial2DView(origin="/map", name="receivers"),
        rrb.TextLogView(origin=f"/{EVENTS}", name="conflicts"),
    )
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(scene, below, row_shares=[2, 1]), tabs, column_shares=[1, 1]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", fps=FRAMES_PER_S),
        collapse_panels=True,
    )


def _build_eye_controls(agent: Agent, world_from_agent: Matrix) -> rrb.EyeControls3D:
    """Place the eye behind and above an agent, tracking the agent."""
    # Only the heading counts: on a slope the eye would look at the sky or at the ground.
    heading = poses.to_yaw_pitch_roll(world_from_agent)[0]
    level = poses.pose_matrix(world_from_agent[:3, 3], yaw=heading)
    return rrb.EyeControls3D(
        position=poses.transform_points(level, (-EYE_BEHIND_M, 0, EYE_ABOVE_M)),
        look_target=poses.transform_points(level, (EYE_AHEAD_M, 0, 0)),
        tracking_entity=f"/{format_agent_path(agent)}",
    )


def _build_image_view(agent: Agent, picture: Picture, name: str) -> rrb.Spatial2DView:
    return rrb.Spatial2DView(origin=f"/{format_sensor_path(agent, picture)}", name=name)


def _build_motion_plots(quantities: Iterable[str]) -> rrb.Grid:
    views = (
        rrb.TimeSeriesView(origin=f"/plots/{name}", name=name.replace("_", " "))
        for name in quantities
    )
    return rrb.Grid(*views, grid_columns=2, name="motion")


def _build_weather_plots() -> rrb.Grid:
    views = (
        rrb.TimeSeriesView(
            origin="/weather",
            contents=[f"/{format_weather_path(name)}" for name in names],
            name=title,
        )
        for title, names in {
            "visibility": ("visibility_m",),
            "rain and snow": ("rain_mm_h", "snow_mm_h"),
            "illuminance": ("illuminance_lx",),
            "wetness": ("wetness",),
        }.items()
    )
    return rrb.Grid(*views, grid_columns=2, name="weather")
