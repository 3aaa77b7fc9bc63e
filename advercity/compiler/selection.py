"""Which crash types a suite is about, and what roads they call for."""

from dataclasses import dataclass

from advercity_dsl import Road, Typology
from advercity_dsl.suite import Coverage, Selection


def has_partner(typology: Typology, rule: Selection) -> bool:
    """Whether there is somebody or something that the driver can misperceive."""
    figures = typology.statistics
    return figures is not None and (
        figures.external_entity or figures.vehicles_per_crash >= rule.vehicles_per_crash
    )


def is_selected(typology: Typology, rule: Selection) -> bool:
    """Whether the crashes are deadly perception errors in which visibility plays a part."""
    figures = typology.statistics
    return (
        figures is not None
        and has_partner(typology, rule)
        and figures.fatality_rate_percent >= rule.fatality_rate_percent
        and figures.bad_visibility_percent >= rule.bad_visibility_percent
    )


@dataclass(frozen=True)
class Cell:
    """A kind of place that a typology's crashes happen at; None stands for any."""

    land_use: str
    junction: str
    geometry: str | None = None

    def holds(self, road: Road) -> bool:
        """Whether `road` is such a place."""
        straight = road.alignment == "straight" and road.profile == "level"
        geometry = "straight" if straight else "curved"
        return (
            self.land_use == road.land_use
            and self.junction == road.junction
            and self.geometry in (None, geometry)
        )

    def __str__(self) -> str:
        """`rural non_junction curved`."""
        return " ".join(part for part in (self.land_use, self.junction, self.geometry) if part)


def required_cells(typology: Typology, rule: Coverage) -> tuple[Cell, ...]:
    """Every place that a typology's road facts call for: the product of its large shares."""
    facts = typology.roads
    if facts is None:
        return ()
    shares = {"urban": facts.urban_percent, "rural": facts.rural_percent}
    land_uses = [use for use, share in shares.items() if share >= rule.land_use_percent]
    junctions = list(
        dict.fromkeys(
            item.junction for item in facts.junctions if item.percent >= rule.junction_percent
        )
    )
    bent = max(facts.non_level_percent or 0, facts.curved_percent or 0)
    geometries = ("straight", "curved") if bent >= rule.geometry_percent else (None,)
    return tuple(
        Cell(land_use, junction, geometry)
        for land_use in land_uses
        for junction in junctions
        for geometry in geometries
    )
