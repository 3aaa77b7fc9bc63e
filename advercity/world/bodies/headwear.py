"""Heads, and what is worn on them: hair, hats, hoods and helmets.

Lengths are shares of the head's height.
"""

from advercity_dsl import Looks

from advercity.world.bodies.figure import Figure
from advercity.world.bodies.flesh import Cone, Flesh
from advercity.world.bodies.skeleton import Bone, Joint
from advercity.world.materials import PAINT
from advercity.world.shapes import xyz


def head(figure: Figure) -> Flesh:
    """Head and neck."""
    unit = figure.build.head_m
    skull = figure.on_head((-0.09, 0, 0.09), (0.08, 0, 0.10), 0.345, 0.335)
    jaw = figure.on_head((0.10, 0, -0.12), (0.19, 0, -0.36), 0.27, 0.115)
    nose = figure.on_head((0.40, 0, 0.02), (0.455, 0, -0.10), 0.03, 0.055)
    ears = [figure.on_head((0, y, 0.02), (-0.03, y, -0.1), 0.07, 0.05) for y in (0.345, -0.345)]
    neck = Cone(
        figure.posture[Joint.NECK] - figure.up() * 0.03 * figure.build.height_m,
        figure.posture[Joint.HEAD] - xyz(0.1 * unit, 0, 0.1 * unit),
        (0.036 * figure.build.height_m, 0.030 * figure.build.height_m),
        Bone.HEAD,
    )
    cell = (0.145 * unit, 0.145 * unit, 0.15 * unit)
    return Flesh(((skull, jaw, nose, *ears), (neck,)), 0.03, cell, 0.02)


def hair(figure: Figure, looks: Looks) -> list[tuple[Flesh, str]]:
    """Hair, a cap over it, or the hood of the top."""
    if looks.hair == "bald":
        return []
    if looks.hair == "hood":
        crown = figure.on_head((-0.14, 0, 0.10), (0.06, 0, 0.15), 0.40, 0.36)
        nape = figure.on_head((-0.16, 0, -0.1), (-0.12, 0, -0.62), 0.36, 0.32)
        return [(figure.shell(crown, nape), PAINT)]
    crown = figure.on_head((-0.13, 0, 0.12), (0.05, 0, 0.165), 0.365, 0.345)
    grown = [crown, figure.on_head((-0.19, 0, 0.10), (-0.2, 0, -0.16), 0.29, 0.23)]
    if looks.hair == "long":
        grown += [
            figure.on_head((-0.1, y, 0.1), (-0.14, 0.95 * y, -0.6), 0.2, 0.15) for y in (0.2, -0.2)
        ]
        grown.append(figure.on_head((-0.24, 0, -0.1), (-0.27, 0, -0.75), 0.24, 0.18))
    if looks.hair == "bun":
        grown.append(figure.on_head((-0.48, 0, 0.16), (-0.52, 0, 0.14), 0.15, 0.13))
    worn = [(figure.shell(*grown), f"hair_{looks.hair_colour}")]
    if looks.hair == "hat":
        worn = [(figure.shell(grown[1]), f"hair_{looks.hair_colour}")]
        cap = figure.on_head((-0.12, 0, 0.15), (0.05, 0, 0.19), 0.385, 0.37)
        peak = figure.on_head((0.40, 0, 0.15), (0.50, 0, 0.11), 0.06, 0.05)
        worn.append((figure.shell(cap, peak), f"cloth_{looks.bag_colour}"))
    return worn


def helmet(figure: Figure) -> Flesh:
    """What covers the top of the head."""
    return figure.shell(figure.on_head((-0.16, 0, 0.14), (0.14, 0, 0.17), 0.43, 0.38))


def chin_guard(figure: Figure) -> Flesh:
    """What makes a helmet one of a motorcyclist."""
    nape = figure.on_head((-0.16, 0, 0.10), (-0.12, 0, -0.22), 0.42, 0.36)
    cheeks = [
        figure.on_head((-0.05, y, -0.2), (0.3, 0.7 * y, -0.3), 0.25, 0.18) for y in (0.2, -0.2)
    ]
    return figure.shell(nape, *cheeks)


def visor(figure: Figure) -> Flesh:
    """Over the face, inside the rims of the helmet."""
    return figure.shell(figure.on_head((0.12, 0, 0.05), (0.2, 0, -0.05), 0.36, 0.30))
