"""Where the actor comes from, and where it meets the ego."""

from advercity.compiler.solving.across import across, ahead
from advercity.compiler.solving.case import Case, Placed
from advercity.compiler.solving.opposite import opposite, straightest_m
from advercity.compiler.solving.overtaking import soonest_m
from advercity.compiler.solving.through import along_edge, in_lane


def placed(case: Case) -> Placed:
    """The actor's way.

    Raises:
        UnsolvableError: There is none on this road.
    """
    match case.conflict.actor.comes:
        case "nearside" | "farside":
            return across(case)
        case "ahead":
            return ahead(case)
        case "opposite_lane" if case.conflict.actor.behaviour == "overtakes":
            return opposite(case, soonest_m(case))
        case "opposite_lane":
            return opposite(case, straightest_m(case.drive))
        case "alongside":
            return along_edge(case)
        case "oncoming" if case.actor.actor_class == "bicycle":
            return along_edge(case)
        case _:
            return in_lane(case)
