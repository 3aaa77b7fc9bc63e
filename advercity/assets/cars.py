"""Builds cars and vans: the shell with its windows and lamps, the inside, and the trim."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from advercity.assets.cabins import CabinSpace, build_cabin
from advercity.assets.car_forms import (
    BELT,
    COWL,
    HEADER,
    MINIBUS,
    PANEL_VAN,
    REAR_FOOT,
    REAR_HEADER,
    CarForm,
    choose_car_form,
)
from advercity.assets.car_surface import ARCH_RADII, CarSurface
from advercity.assets.car_trim import build_trim
from advercity.assets.vehicle_parts import build_axle, make_vehicle_parts, set_layer
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    MeshLayer,
    MeshPart,
    Size,
    TriangleSurface,
    add_mirror_image,
    keep_triangles,
)
from advercity.geometry.primitives import box, ellipsoid
from advercity.materials import ACTOR_PAINT
from advercity.randomness import create_generator


class _Region(NamedTuple):
    """A rectangle of u and v on the shell with a material of its own."""

    material: str
    u: tuple[float, float]
    v: tuple[float, float]


_DARK, _GLASS = "black_plastic", "glass"
_HEADLAMP_COLUMNS, _TAIL_LAMP = (1.5, 3.1), ((16.95, 18.75), (3.9, 5.55))
_CAB_INTAKE_ROWS = (2.0, 2.6)
"""Rows of the lower air intake of a truck's cab."""
_LAMP_DEPTH_M, _LINING_M = 0.05, 0.015
_REAR_WINDOW = (
    _Region(_DARK, (REAR_HEADER, REAR_FOOT), (7.42, 10)),
    _Region(_GLASS, (REAR_HEADER + 0.06, REAR_FOOT - 0.14), (7.42, 10)),
)
_LINES_U = (0, 0.55, 1.1, 1.5, 1.9, 2.4, 3.1, 3.6, COWL, 7.14, 7.6, 8.3, HEADER - 0.06, 9.6, 10.6,
            12, 13.06, 13.45, 14.1, 14.86, 15.6, 16.3, 16.95, 17.6, 18.2, 18.75, 19.4,
            20)  # fmt: skip
_LINES_V = (0, 1, 1.4, 2, 2.6, 3.3, 3.9, 5.05, 5.55, 6, 6.13, 6.9, 7.06, 7.42, 8.4, 10)


def build_car(blueprint_id: str, size: Size) -> list[MeshPart]:
    """Build a car of about `size`, x forward, on the ground."""
    length, width, height = size
    form = choose_car_form(length, height)
    if "police" not in blueprint_id:
        return _build_motor_car(blueprint_id, size, form)
    lower = (length, width, height - 0.10)
    return _build_motor_car(blueprint_id, lower, form) + _build_light_bar(form, size)


def build_van(blueprint_id: str, size: Size) -> list[MeshPart]:
    """Build a minibus, or a panel van if it is high."""
    return _build_motor_car(blueprint_id, size, PANEL_VAN if size[2] > 2.3 else MINIBUS)


def _build_motor_car(blueprint_id: str, size: Size, form: CarForm) -> list[MeshPart]:
    """Build a car of a form; the size of its wheels varies with the blueprint."""
    length, width, height = size
    factor = create_generator("car", blueprint_id).uniform(0.97, 1.03)
    radius = min(form.wheel_m, 0.13 * length, 0.235 * height) * factor
    body = CarSurface(form, length, 0.455 * width, height, radius)
    front, rear = (body.x_at(station) for station in form.axles)
    outer, wide = body.half - 0.012, 0.25 * body.half
    return [
        *build_body_on_wheels(blueprint_id, body, width),
        *build_axle(front, outer, radius, wide, is_steered=True),
        *build_axle(rear, outer, radius, wide),
    ]


def build_body_on_wheels(blueprint_id: str, body: CarSurface, width: float) -> list[MeshPart]:
    """Build a car or a truck's cab without wheels; `width` includes the mirrors."""
    return [
        *_build_shell(body),
        *_build_lamps(body),
        *_build_floor(body),
        *build_cabin(blueprint_id, _measure_cabin(body)),
        *set_layer(MeshLayer.DETAIL, build_trim(blueprint_id, body, width)),
    ]


def _build_shell(body: CarSurface) -> list[MeshPart]:
    """Build the shell, split by material along lines of the surface."""
    u, v = _list_shell_lines(body), _list_rows(body.form)
    middle_u, middle_v = np.meshgrid((u[1:] + u[:-1]) / 2, (v[1:] + v[:-1]) / 2, indexing="ij")
    materials = np.full(middle_u.shape, ACTOR_PAINT, dtype=object)
    for region in _list_regions(body):
        (u0, u1), (v0, v1) = region.u, region.v
        inside = (middle_u > u0) & (middle_u < u1) & (middle_v > v0) & (middle_v < v1)
        materials[inside] = region.material
    surface, inner = body.build_patch(u, v), body.build_patch(u, v, -_LINING_M)
    kinds = materials.ravel().repeat(2)
    pieces = {
        name: add_mirror_image(keep_triangles(surface, kinds == name))
        for name in sorted(set(kinds) - {""})
    }
    above_belt = (middle_v > BELT).ravel().repeat(2) & (middle_u > COWL).ravel().repeat(2)
    above_belt &= (middle_u < REAR_FOOT).ravel().repeat(2)
    lining = keep_triangles(inner, above_belt & (kinds != _GLASS))
    parts = [part for name, piece in pieces.items() for part in make_vehicle_parts(name, piece)]
    lining = add_mirror_image(replace(lining, triangles=lining.triangles[:, ::-1]))
    return [*parts, *set_layer(MeshLayer.DETAIL, make_vehicle_parts("upholstery", lining))]


def _measure_cabin(body: CarSurface) -> CabinSpace:
    (foot,), (rear,), (pillar,) = (body.locate(u, [6.0]) for u in (COWL, REAR_FOOT - 0.4, 11.0))
    (roof,) = body.locate(11.0, [10.0])
    is_van = not all(body.form.side_windows)
    return CabinSpace(
        front=foot[0],
        rear=body.x_at(body.form.pillar) - 0.25 if is_van else rear[0],
        half=0.93 * pillar[1],
        belt=min(foot[2] - 0.03, pillar[2]),
        roof=min(roof[2] - 0.05, pillar[2] + 0.66),
        floor=body.form.clearance_m + 0.13,
    )


def _build_floor(body: CarSurface) -> list[MeshPart]:
    """Build the underside of the car, and the inner sides of the wheel wells."""
    low, inner = body.form.clearance_m + 0.015, 0.63 * body.half
    middle, high = low + 0.1, 0.8 * body.form.belt[0] * body.height
    nose, tail = 0.008 + 0.03 * body.form.nose_rake, 0.992 - 0.03 * body.form.tail_rake
    boxes = [box((body.x_at(tail), -inner, low), (body.x_at(nose), inner, middle))]
    axles = body.form.axles[: 1 if body.form.is_cab else 2]
    for axle, end in zip(axles, (0.03, 0.97), strict=False):
        x, wide = body.x_at(axle), ARCH_RADII * body.wheel_m + 0.02
        boxes.append(box((x - wide, -inner, low), (x + wide, inner, high)))
        beyond = sorted((body.x_at(end), x + wide * (1 if end < 0.5 else -1)))
        outer = 0.84 * body.half
        boxes.append(box((beyond[0], -outer, low + 0.03), (beyond[1], outer, middle)))
    return make_vehicle_parts("black_plastic", *boxes)


def _list_shell_lines(body: CarSurface) -> Float64Array:
    """List the lines u (n,) of the shell: edges of parts, and close ones around the wheels."""
    arch = ARCH_RADII * body.wheel_m / body.length
    steps = arch * np.array([-1.0, -0.93, -0.6, 0.0, 0.6, 0.93, 1.0])
    edge = arch + 0.003
    wells = [axle + np.array([-edge, *steps, edge]) for axle in body.form.axles]
    pillar = body.form.pillar + np.array([-0.011, 0.011])
    lines = np.unique(np.concatenate([_LINES_U, body.u_at(np.concatenate([*wells, pillar]))]))
    return lines[np.concatenate([[True], np.diff(lines) > 0.01])]


def _list_rows(form: CarForm) -> Float64Array:
    """List the lines v (n,) of the shell."""
    return np.unique([*_LINES_V, *form.headlamp_rows, *form.grille_rows])


def _list_regions(body: CarSurface) -> list[_Region]:
    """List the unpainted parts of the shell; later ones lie over earlier ones."""
    form = body.form
    before, behind = body.u_at(form.pillar + np.array([-0.0111, 0.0111]))
    sill = 2.0 if form.is_rugged else 1.4
    windows = [(7.6, before), (behind, 13.45)]
    panes = [ends for ends, is_glazed in zip(windows, form.side_windows, strict=True) if is_glazed]
    return [
        _Region(_DARK, (0, 20), (0, sill)),
        _Region(_DARK, (0, 20 if form.is_cab else 1.9), (1, 2.0 if form.is_cab else 2.6)),
        _Region(_DARK, (18.2, 20), (1, 2.0)),
        _Region(_DARK, (0, 1.1), form.grille_rows),
        *((_Region(_DARK, (0, 1.1), _CAB_INTAKE_ROWS),) if form.is_cab else ()),
        _Region(_DARK, (7.14, panes[-1][1]), (6, 7.06)),
        *(_Region(_GLASS, ends, (6.13, 6.9)) for ends in panes),
        _Region(_DARK, (COWL, HEADER), (7.06, 10)),
        _Region(_GLASS, (COWL + 0.14, HEADER - 0.06), (7.42, 10)),
        *(_REAR_WINDOW if all(form.side_windows) else ()),
        _Region("", _HEADLAMP_COLUMNS, form.headlamp_rows),
        *(() if form.is_cab else (_Region("lamp_red", *_TAIL_LAMP),)),
    ]


def _build_lamps(body: CarSurface) -> list[MeshPart]:
    """Build headlamps as bowls with lenses behind a cover, and tail lamps in red and amber."""
    (u0, u1), (v0, v1) = headlamp = _HEADLAMP_COLUMNS, body.form.headlamp_rows
    lens_u, lens_v = np.array([u0 + 0.45, u0 + 0.85]), np.full(2, (v0 + v1) / 2 - 0.1)
    lenses = [
        ellipsoid(place - 0.03 * normal, (0.035, 0.062, 0.055), sides=8, bands=4)
        for place, normal in zip(
            body.locate(lens_u, lens_v), body.compute_normals(lens_u, lens_v), strict=True
        )
    ]
    indicator = body.build_patch(np.linspace(u1 - 0.55, u1 - 0.1, 3), [v0 + 0.3, v1 - 0.4], -0.012)
    pieces = (
        ("chrome", _build_bowl(body, headlamp)),
        ("lamp_white", *lenses),
        ("lamp_amber", indicator),
        *(() if body.form.is_cab else _build_tail_lamps(body)),
    )
    return [
        part
        for name, *surfaces in pieces
        for part in make_vehicle_parts(name, *map(add_mirror_image, surfaces))
    ]


def _build_tail_lamps(body: CarSurface) -> tuple[tuple[str, TriangleSurface], ...]:
    """Build the indicator and the reversing lamp on the left tail lamp."""
    (t0, t1), (w0, _) = _TAIL_LAMP
    amber = body.build_patch(np.linspace(t0 + 0.35, t1 - 0.3, 4), [w0 + 0.56, w0 + 0.9], 0.014)
    clear = body.build_patch(np.linspace(t1 - 0.6, t1 - 0.25, 3), [w0 + 0.15, w0 + 0.5], 0.014)
    return ("lamp_amber", amber), ("chrome", clear)


def _build_bowl(body: CarSurface, rectangle: tuple[tuple[float, float], ...]) -> TriangleSurface:
    """Build a hollow of the surface within a rectangle of u and v."""
    u, v = (np.linspace(*ends, 6) for ends in rectangle)
    depth = np.sqrt(1 - np.linspace(-1, 1, 6) ** 6)
    return body.build_patch(u, v, -_LAMP_DEPTH_M * np.outer(depth, depth))


def _build_light_bar(form: CarForm, size: Size) -> list[MeshPart]:
    length, width, height = size
    x = length * (0.5 - (form.cabin[1] + form.cabin[2]) / 2)
    low, half = height - 0.12, 0.27 * width
    red, blue = (
        box((x - 0.12, y0, low), (x + 0.12, y1, height))
        for y0, y1 in ((0.02, half), (-half, -0.02))
    )
    return [*make_vehicle_parts("sign_red", red), *make_vehicle_parts("car_paint_blue", blue)]
