"""Rooms behind the panes of buildings: interior mapping (van Dongen 2008), as shaders have it.

A ray is followed to the walls of a box, and to furniture in it. `rooms.glsl` has the same, and
`advercity.scene.rooms` defines the coordinates of panes. Axes of a room are to the right, up and
inward, from the lower left corner of its window.
"""

from dataclasses import dataclass
from typing import Any

from advercity.materials import Texture
from advercity.scene.rooms import (
    BLIND_RATIO,
    BLIND_STEPS,
    COVER_DEPTH_M,
    CURTAIN_FRACTION,
    MEAN_CLOTH,
    MEAN_ROOM,
    MEAN_SHOP,
    ROOM_ABOVE_M,
    ROOM_ASIDE_M,
    ROOM_DEPTH_M,
    ROOM_DEPTH_SPREAD_M,
    SHOP_DAY_RATIO,
    SHOP_SILL_M,
    SILL_M,
    TALL_SILL_M,
    TALL_WINDOW_M,
    WINDOW_TRANSMITTANCE,
)
from advercity_mitsuba.noise import hash_cell, retained_contrast
from advercity_mitsuba.variant import dr, mi


@dataclass
class _Room:
    number: Any
    is_shop: Any
    is_lit: Any
    window: Any
    low: Any
    high: Any


@dataclass
class _RoomHit:
    distance: Any
    normal: Any
    piece: Any


def is_room(kind: Any) -> Any:
    """Whether a surface is a pane before a room."""
    return (kind == int(Texture.ROOM)) | (kind == int(Texture.SHOP))


def compute_room_albedo(
    *,
    kind: Any,
    base: Any,
    is_lit: Any,
    at: Any,
    scale: Any,
    axes: tuple[Any, Any, Any],
    ray: Any,
    pixel_m: Any,
) -> Any:
    """Compute the apparent albedo of a pane by the room behind it.

    Args:
        kind: Number of the material's `Texture`.
        base: Mean albedo, to which it fades.
        is_lit: Whether the lamp of the room is lit.
        at: Coordinates of the mesh.
        scale: Metres per unit of these, 0 without any.
        axes: To the right, up and out of the wall.
        ray: Direction of sight.
        pixel_m: Width of a pixel at the surface, across the ray.
    """
    code = mi.Vector2i(dr.floor(at))
    window = 0.5 * scale
    room = _build_room(kind, code.x, is_lit, window)
    place = (2.0 * (at - mi.Point2f(code)) - 0.5) * window
    start = mi.Vector3f(place.x, place.y, 0.0)
    inward = dr.maximum(-dr.dot(ray, axes[2]), 0.02)
    along = mi.Vector3f(dr.dot(ray, axes[0]), dr.dot(ray, axes[1]), inward)
    is_covered, cover = _compute_cover(
        room, code.y, base, start + along * (COVER_DEPTH_M / inward), pixel_m
    )
    hit = _find_hit(room, start, along)
    found = start + along * hit.distance
    seen = _find_albedo(room, hit, found, pixel_m) * _compute_light(room, found, hit.normal)
    mean = dr.select(room.is_shop, mi.Float(MEAN_SHOP), MEAN_ROOM)
    inside = dr.select(is_lit, base * seen / mean, WINDOW_TRANSMITTANCE * seen)
    faded = dr.lerp(base, inside, retained_contrast(1.5, pixel_m))
    return dr.select(scale.x <= 0.0, base, dr.select(is_covered, cover, faded))


def _draw(number: Any, salt: Any) -> Any:
    return 0.5 + 0.5 * hash_cell(number, 7, salt)


def _draw_colour(number: Any, salt: int) -> Any:
    return mi.Color3f(_draw(number, salt), _draw(number, salt + 1), _draw(number, salt + 2))


def _build_room(kind: Any, number: Any, is_lit: Any, window: Any) -> _Room:
    is_shop = kind == int(Texture.SHOP)
    upper = dr.select(window.y > TALL_WINDOW_M, mi.Float(TALL_SILL_M), SILL_M)
    sill = dr.select(is_shop, SHOP_SILL_M, upper)
    low = mi.Vector3f(-ROOM_ASIDE_M - _draw(number, 1), -sill, 0.0)
    high = mi.Vector3f(
        window.x + ROOM_ASIDE_M + _draw(number, 2),
        window.y + ROOM_ABOVE_M,
        ROOM_DEPTH_M + ROOM_DEPTH_SPREAD_M * _draw(number, 3),
    )
    return _Room(number, is_shop, is_lit, window, low, high)


def _place_piece(room: _Room, piece: int) -> tuple[Any, Any]:
    """Find the corners of a piece of furniture.

    A cupboard and a table are in rooms, shelves and two stands behind the window in shops.
    """
    number, salt = room.number, 10 + 8 * piece
    width, height = _draw(number, salt), _draw(number, salt + 1)
    if piece == 0:
        size = mi.Vector3f(1.2 + width, 0.8 + 1.3 * height, 0.5)
        nearest = dr.select(room.is_shop, 1.9, room.high.z - 0.5)
    else:
        stand = mi.Vector3f(0.5 + 0.9 * width, 0.8 + 0.9 * height, 0.4)
        size = dr.select(room.is_shop, stand, mi.Vector3f(1.2 + width, 0.75, 0.8))
        nearest = dr.select(room.is_shop, mi.Float(0.35), 1.2)
    free = dr.maximum(room.high.x - room.low.x - size.x, 0.0)
    low = mi.Vector3f(room.low.x + free * _draw(number, salt + 2), room.low.y, nearest)
    return low, low + size


def _find_hit(room: _Room, start: Any, along: Any) -> _RoomHit:
    per = 1.0 / dr.select(along == 0.0, 1e-6, along)
    exits = (dr.select(along > 0.0, room.high, room.low) - start) * per
    distance = dr.minimum(dr.minimum(exits.x, exits.y), exits.z)
    facing = -mi.Vector3f(*(_sign(part) for part in along))
    normal = dr.select(exits <= distance, facing, 0.0)
    piece = mi.Int32(-1)
    for number in range(3):
        low, high = _place_piece(room, number)
        one, other = (low - start) * per, (high - start) * per
        first, last = dr.minimum(one, other), dr.maximum(one, other)
        enters = dr.maximum(dr.maximum(first.x, first.y), first.z)
        leaves = dr.minimum(dr.minimum(last.x, last.y), dr.minimum(last.z, distance))
        is_hit = (enters > 0.0) & (enters < leaves)
        if number == 2:
            is_hit &= room.is_shop
        distance = dr.select(is_hit, enters, distance)
        normal = dr.select(is_hit, dr.select(first >= enters, facing, 0.0), normal)
        piece = dr.select(is_hit, mi.Int32(number), piece)
    return _RoomHit(distance, normal, piece)


def _sign(value: Any) -> Any:
    return dr.select(value > 0.0, mi.Float(1.0), dr.select(value < 0.0, mi.Float(-1.0), 0.0))


def _find_goods(number: Any, at: Any, pixel_m: Any) -> Any:
    """Find the albedo of goods on shelves, at metres along them and above the floor."""
    width, height = 0.17, 0.36
    x, y = mi.Int32(dr.floor(at.x / width)), mi.Int32(dr.floor(at.y / height))
    above = at.y - mi.Float(y) * height
    third = mi.Int32(dr.floor(mi.Float(x) / 3.0))
    good, one = number + 31 * third + 57 * y, number + 13 * x + 57 * y
    albedo = 0.08 + 0.35 * _draw_colour(good, 40) + 0.3 * _draw(one, 43)
    albedo = dr.select(above > 0.16 + 0.14 * _draw(one, 44), mi.Color3f(0.12), albedo)
    albedo = dr.select(above < 0.03, mi.Color3f(0.6), albedo)
    return dr.lerp(mi.Color3f(0.33), albedo, retained_contrast(0.6, pixel_m))


def _find_wall(room: _Room, at: Any, side: Any, pixel_m: Any) -> Any:
    number = room.number
    paint = 0.45 + 0.35 * _draw(number, 4) + 0.12 * (_draw_colour(number, 5) - 0.5)
    shop = dr.select(at.y < 2.0, _find_goods(number + side, at, pixel_m), paint)
    door = 0.3 + 1.5 * _draw(number, 50 + side)
    is_door = (at.x > door) & (at.x < door + 0.9) & (at.y < 2.05)
    picture = dr.floor(at.x / 1.1)
    key = number + 17 * mi.Int32(picture) + 71 * side
    across, up = dr.abs(at.x - (picture + 0.5) * 1.1), dr.abs(at.y - 1.6)
    is_hung = (_draw(key, 62) < 0.5) & (at.x > door + 0.9)
    is_hung &= (across < 0.15 + 0.25 * _draw(key, 60)) & (up < 0.15 + 0.25 * _draw(key, 61))
    flat = dr.select(is_hung, 0.05 + 0.6 * _draw_colour(key, 63), paint)
    flat = dr.select(is_door, mi.Color3f(0.35, 0.24, 0.15), flat)
    return dr.select(room.is_shop, shop, flat)


def _find_albedo(room: _Room, hit: _RoomHit, at: Any, pixel_m: Any) -> Any:
    number = room.number
    across = dr.select(dr.abs(hit.normal.x) > 0.5, at.z, at.x - room.low.x)
    place = mi.Point2f(across, at.y - room.low.y)
    wood = dr.lerp(
        mi.Color3f(0.22, 0.13, 0.08), mi.Color3f(0.6, 0.55, 0.48), _draw(number, 70 + hit.piece)
    )
    gap = across / 0.6 - dr.floor(across / 0.6) < 0.03
    wood = dr.select(gap, 0.4 * wood, wood)
    goods = _find_goods(number + 5 * hit.piece, place, pixel_m)
    floor = dr.lerp(mi.Color3f(0.3, 0.19, 0.11), mi.Color3f(0.4), _draw(number, 80))
    wall = _find_wall(room, place, mi.Int32(hit.normal.x) + 1, pixel_m)
    room_itself = dr.select(hit.normal.y < -0.5, mi.Color3f(0.75), wall)
    room_itself = dr.select(hit.normal.y > 0.5, floor, room_itself)
    return dr.select(hit.piece >= 0, dr.select(room.is_shop, goods, wood), room_itself)


def _compute_light(room: _Room, at: Any, normal: Any) -> Any:
    """Compute light on a surface relative to the light on the pane.

    It is the window's own, and by the split-flux method the room's reflection; shops have lamps by
    day, too. By night it is relative to the mean of the lamp under the ceiling.
    """
    size, window = room.high - room.low, room.window
    lamp = mi.Vector3f(0.5 * (room.low.x + room.high.x), room.high.y - 0.5, 0.5 * room.high.z)
    pane = mi.Vector3f(0.5 * window.x, 0.5 * window.y, 0.0)
    away = at - dr.select(room.is_lit, lamp, pane)
    square, facing = dr.squared_norm(away), dr.maximum(-dr.dot(normal, away), 0.0)
    by_lamp = 0.5 + 1.3 * facing * dr.rsqrt(square + 0.01) / (0.5 + square)
    area = window.x * window.y
    all_faces = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x)
    direct = dr.maximum(away.z, 0.0) * facing / (square * (dr.pi * square + area) + 1e-3)
    by_day = area * (direct + 1.0 / all_faces) + dr.select(room.is_shop, SHOP_DAY_RATIO, 0.0)
    return dr.select(room.is_lit, by_lamp, by_day)


def _compute_cover(room: _Room, cover: Any, base: Any, at: Any, pixel_m: Any) -> tuple[Any, Any]:
    """Compute whether a curtain or blind is seen, and its apparent albedo."""
    window = room.window
    aside = dr.minimum(at.x, window.x - at.x) / window.x
    is_curtain = (cover == 1) & (aside < CURTAIN_FRACTION)
    is_blind = (cover > 1) & (at.y > window.y * (1.0 - (mi.Float(cover) - 1.0) / BLIND_STEPS))
    fold = 0.15 * retained_contrast(0.14, pixel_m) * dr.sin(45.0 * at.x)
    light, dark = mi.Color3f(0.62, 0.60, 0.55), mi.Color3f(0.42, 0.37, 0.31)
    cloth = dr.lerp(light, dark, _draw(room.number, 90))
    cloth *= 1.0 + dr.select(cover == 1, fold, 0.0)
    lit = BLIND_RATIO * base * cloth / MEAN_CLOTH
    return is_curtain | is_blind, dr.select(room.is_lit, lit, WINDOW_TRANSMITTANCE * cloth)
