"""Import of OpenDRIVE, OpenStreetMap, Lanelet2 and SUMO files as the SUMO network of a road."""

from collections.abc import Callable, Mapping
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from advercity_dsl import MapFile, MapNetwork, Road
from advercity_dsl.road.extent import MAX_SITE_M

from advercity.errors import InputError
from advercity.foreign.ledger import Ledger
from advercity.roads.imported_crossings import count_unbuilt
from advercity.roads.lanelet2.plan import plan_lanelet2
from advercity.roads.map_conversion import convert
from advercity.roads.map_files import read_map_file
from advercity.roads.map_names import read_street_names, rename_network
from advercity.roads.map_plan import MapPlan
from advercity.roads.network_file import SumoLane, SumoNetwork, parse_network
from advercity.roads.opendrive.plan import plan_opendrive
from advercity.roads.osm_plan import plan_extract
from advercity.roads.sumo_plan import plan_network
from advercity.roads.sumo_xml import pack_network, sanitize_network

MAX_LANE_WIDTH_M = 60.0
"""Limit of a declared strip."""
PLANNERS: Mapping[str, Callable[[Element, Road, MapFile, Ledger], MapPlan]] = {
    "lanelet2": plan_lanelet2,
    "opendrive": plan_opendrive,
    "osm": plan_extract,
    "sumo": plan_network,
}
"""Readers of the formats, by source."""


def import_map(declared: MapFile, road: Road, folder: Path) -> MapNetwork:
    """Convert a map to a network.

    Its file is relative to `folder`; the road's origin locates latitudes and longitudes.

    Raises:
        InputError: The file is missing, unsafe, of another kind, too large, or without a lane for
            cars.
        RunError: `netconvert` does not run.
    """
    found = read_map_file(declared, folder)
    ledger = Ledger()
    try:
        plan = PLANNERS[declared.source](found.root, road, declared, ledger)
        net = _build_network(plan, ledger)
    except InputError as error:
        within = "" if declared.extent_m is None else " (within `extent_m`)"
        raise InputError(f"{declared.file}: {error}{within}") from None
    return MapNetwork(
        source=declared.source,
        sha256=found.sha256,
        network=pack_network(net),
        offset_m=plan.origin_m,
        place=plan.place,
        driving_side=plan.driving_side,
        left_out=ledger.left_out,
    )


def _build_network(plan: MapPlan, ledger: Ledger) -> Element:
    """Convert a map as planned, with its names for the streets."""
    converted = convert(plan.conversion)
    _check_lanes(_parse_converted(converted))
    second = plan.confirm(plan.crossings, converted) if plan.crossings and plan.confirm else None
    if second is not None:
        converted = convert(second)
    if unbuilt := count_unbuilt(plan.crossings, converted):
        name, plural = (
            f"pedestrian crossing{end} where none can be built (away from junctions, or without"
            " sidewalks)"
            for end in ("", "s")
        )
        ledger.leave_out(name, plural=plural, count=unbuilt)
    net = sanitize_network(converted)
    plan.complete(net)
    rename_network(net, read_street_names(converted) if plan.names is None else plan.names)
    return net


def _parse_converted(net: Element) -> SumoNetwork:
    """Parse the output of netconvert, which copies malformed numbers of a map."""
    try:
        return parse_network(net)
    except ValueError as error:
        raise InputError(f"netconvert cannot use it: {error}") from None


def _check_lanes(network: SumoNetwork) -> None:
    """Check that a network has room for a car, and fits on a site."""
    # A world of a shorter lane would have none: such close points of its line are left out.
    if not any(lane.is_driving_lane and len(lane.centre) > 1 for lane in network.lanes):
        raise InputError("has no lane for cars")
    for lane in network.lanes:
        if not 0 < lane.width_m <= MAX_LANE_WIDTH_M:
            raise InputError(
                f"has a lane of {lane.width_m:g} m width,"
                f" {_describe_lane(lane)}; lanes are at most {MAX_LANE_WIDTH_M:g} m wide"
            )
    points = np.concatenate([lane.shape for lane in network.lanes])
    directions = ("from west to east", "from south to north")
    for size_m, direction in zip(np.ptp(points[:, :2], axis=0), directions, strict=True):
        if not size_m <= MAX_SITE_M:
            raise InputError(
                f"its lanes are {size_m:g} m {direction}; the limit is"
                f" {MAX_SITE_M:g} m, to which `extent_m` cuts a map"
            )
    height_m = points[np.abs(points[:, 2]).argmax(), 2]
    if not abs(height_m) <= MAX_SITE_M:
        raise InputError(f"has a lane {height_m:g} m above zero; the limit is {MAX_SITE_M:g} m")


def _describe_lane(lane: SumoLane) -> str:
    east_m, north_m = lane.shape[0, :2]
    return f"at {east_m:.6g} m east and {north_m:.6g} m north"
