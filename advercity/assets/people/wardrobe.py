"""Dresses a shaped person: garments, hair, shoes and eyes as shells over the base mesh.

Garments are cut from the surfaces around the body along hems at heights and along arms, moved off
the body, and draped. Skin under them is left out, so it cannot come through.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from advercity_dsl import PedestrianAppearance
from numpy.typing import NDArray

from advercity.assets.people.base_mesh import BaseMesh
from advercity.assets.people.shells import (
    SNAP_DECIMALS,
    Shell,
    add_hems,
    clip_shell,
    drape_shell,
    join_shells,
    simplify_shell,
)
from advercity.assets.skeleton import BONE_SIDES, Bone, bone_on_side
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import xyz
from advercity.geometry.primitives import ellipsoid
from advercity.materials import ACTOR_PAINT

SKIN_MATERIALS = {"light": "skin", "brown": "skin_brown", "dark": "skin_dark"}
SHOE_MATERIAL = "leather"
_ARM_BONES = [
    bone_on_side(bone, left) for bone in (Bone.UPPER_ARM, Bone.FOREARM) for left in (1, -1)
]
_LEG_BONES = [bone_on_side(bone, left) for bone in (Bone.THIGH, Bone.SHIN) for left in (1, -1)]
_HEM_M, _OVERLAP_M = 0.012, 0.03
_TRIANGLES = {
    "skin": 2000,
    "hair": 500,
    "top": 1000,
    "bottom": 700,
    "skirt": 500,
    "shoe": 500,
    "eyes": 60,
    "patch": 60,
}
_LIP_MATERIALS = {"light": "skin_brown", "brown": "skin_dark", "dark": "skin_dark"}
_HAIR_LINE = (
    (-0.083, 0.083, 0.20, 0.24, 0.44, 0.50, 0.667),
    (0.892, 0.867, 0.72, 0.56, 0.54, 0.33, 0.25),
)
"""Edge of the hair: distances behind the eyes, and heights above the chin, in heads."""
_FAR = 9.0
"""A distance in metres beyond any body, for places unaffected by a hem."""


@dataclass(frozen=True, eq=False)
class Measures:
    """Reference points of hems, on a shaped person with arms and legs a little apart.

    Attributes:
        height_m: Standing height.
        joints: Left and middle joints, (3,) by name.
        crown_z, chin_z: Top of the head and bottom of the chin.
    """

    height_m: float
    joints: Mapping[str, Float64Array]
    crown_z: float
    chin_z: float


@dataclass(frozen=True, eq=False)
class Wardrobe:
    """Cuts garments from one shaped person.

    Attributes:
        base: The base mesh.
        vertices: (n, 3) of the shaped person, feet at 0.
        measures: Its measures.
    """

    base: BaseMesh
    vertices: Float64Array
    measures: Measures

    def dress(self, looks: PedestrianAppearance) -> list[tuple[Shell, str]]:
        """Build all visible parts, with materials; the top has the actor's paint."""
        worn = self._build_top(looks)
        bottom = f"cloth_{looks.bottom_colour}"
        if looks.bottom != "skirt":
            worn.append((self._build_trousers(looks), bottom))
        elif looks.top != "coat":
            worn.append((self._build_skirt(self._skirt_hem_z, (0.013, 0.013)), bottom))
        worn += [(self._build_shoes(), SHOE_MATERIAL), *self._build_head_wear(looks)]
        worn += [(self._build_skin(looks), SKIN_MATERIALS[looks.skin])]
        return worn + self._build_face(looks) + self._build_bag(looks)

    def take(self, group: str) -> Shell:
        """Return the surface of a group of the base mesh."""
        return Shell(self.vertices, self.base.groups[group], self.base.weights).compact()

    @property
    def _hip_z(self) -> float:
        return float(self.measures.joints["upper-leg"][2])

    @property
    def _knee_z(self) -> float:
        return float(self.measures.joints["knee"][2])

    @property
    def _ankle_z(self) -> float:
        return float(self.measures.joints["ankle"][2])

    @property
    def _skirt_hem_z(self) -> float:
        return 0.7 * self._knee_z + 0.3 * self._hip_z

    @property
    def _waist_z(self) -> float:
        return self._hip_z + 0.055 * self.measures.height_m

    def _measure_sleeve(self, shell: Shell, length: float) -> Float64Array:
        """Measure how far (n,) vertices are inside sleeves of a length, 1 ending at the wrists."""
        shoulder, wrist = self.measures.joints["shoulder"], self.measures.joints["hand"]
        reach = float(np.sqrt(((wrist - shoulder) ** 2).sum()))
        mirrored = shell.vertices * np.where(shell.vertices[:, 1:2] < 0, (1, -1, 1), (1, 1, 1))
        along = ((mirrored - shoulder) * ((wrist - shoulder) / reach)).sum(axis=1)
        return np.where(_is_arm(shell), length * reach - along, _FAR)

    def _measure_hem(self, shell: Shell, z: float) -> Float64Array:
        """Measure how far (n,) vertices are above a hem; arms have none."""
        return np.where(_is_arm(shell), _FAR, shell.vertices[:, 2] - z)

    def _measure_collar(self, shell: Shell, rise: float = 0.0) -> Float64Array:
        """Measure how far (n,) vertices are below a collar, which is lower in front."""
        neck = self.measures.joints["neck"]
        z = neck[2] + (0.012 + rise) * self.measures.height_m
        return z - shell.vertices[:, 2] - 0.55 * (shell.vertices[:, 0] - neck[0])

    def _cover_top(self, shell: Shell, looks: PedestrianAppearance) -> Float64Array:
        sleeve = 0.36 if looks.top == "shirt" else 0.99
        rise = 0.012 if looks.top == "shirt" else -0.03
        if looks.bottom == "skirt" and looks.top != "coat":
            rise = 0.045  # tucked in
        hem = self._hip_z + rise * self.measures.height_m
        fields = self._measure_sleeve(shell, sleeve), self._measure_hem(shell, hem)
        return np.minimum(np.minimum(*fields), self._measure_collar(shell))

    def _cover_bottom(self, shell: Shell, looks: PedestrianAppearance) -> Float64Array:
        hem = {
            "trousers": self._ankle_z + 0.004 * self.measures.height_m,
            "shorts": self._knee_z,
            "skirt": self._skirt_hem_z + 0.03 * self.measures.height_m,
        }
        low = hem[looks.bottom]
        field = np.minimum(shell.vertices[:, 2] - low, self._waist_z - shell.vertices[:, 2])
        return np.where(_is_arm(shell), -_FAR, field)

    def _measure_coat(self, shell: Shell) -> Float64Array:
        """Measure how far (n,) vertices of legs are below the part always hidden by a coat."""
        return self._knee_z + 0.05 * self.measures.height_m - shell.vertices[:, 2]

    def _build_top(self, looks: PedestrianAppearance) -> list[tuple[Shell, str]]:
        h, tights = self.measures.height_m, self.take("helper-tights")
        shell = clip_shell(tights, self._cover_top(tights, looks))
        ease = np.full(
            len(shell.vertices), {"shirt": 0.005, "jacket": 0.008, "coat": 0.009}[looks.top]
        )
        if looks.bottom != "skirt":
            low = np.clip((self._waist_z + 0.1 * h - shell.vertices[:, 2]) / (0.1 * h), 0, 1)
            ease += np.where(_is_arm(shell), 0.0, 0.005 * low)
        collar = np.clip(self._measure_collar(shell) / (0.04 * h), 0.2, 1.0)
        draped = self._finish(shell, ease * collar * h, "top")
        if looks.top == "shirt":
            return [(draped, ACTOR_PAINT)]
        front = self._measure_lapel(draped)
        worn = [
            (clip_shell(draped, front), ACTOR_PAINT),
            (clip_shell(draped, -front), "cloth_light"),
        ]
        if looks.top == "coat":
            worn.append((self._build_skirt(self._knee_z, (0.010, 0.022)), ACTOR_PAINT))
        return worn

    def _measure_lapel(self, shell: Shell) -> Float64Array:
        """Measure how far (n,) vertices are outside the opening of a jacket, a V."""
        neck, h = self.measures.joints["neck"], self.measures.height_m
        width = 0.036 * h - 0.36 * np.maximum(neck[2] - shell.vertices[:, 2], 0.0)
        ahead = shell.vertices[:, 0] - neck[0]
        return np.where(ahead > 0.0, np.abs(shell.vertices[:, 1]) - width, _FAR)

    def _finish(self, shell: Shell, ease: Float64Array, kind: str, rounds: int = 6) -> Shell:
        """Drape a cut surface, fold its hems, and simplify it."""
        return simplify_shell(add_hems(drape_shell(shell, ease, rounds), _HEM_M), _TRIANGLES[kind])

    def _build_trousers(self, looks: PedestrianAppearance) -> Shell:
        h, tights = self.measures.height_m, self.take("helper-tights")
        field = self._cover_bottom(tights, looks)
        if looks.top == "coat":
            field = np.minimum(field, self._measure_coat(tights))
        shell = clip_shell(tights, field)
        down = np.clip((self._hip_z - shell.vertices[:, 2]) / self._hip_z, 0.0, 1.0)
        return self._finish(shell, (0.004 + 0.010 * down) * h, "bottom")

    def _build_skirt(self, hem_z: float, ease: tuple[float, float]) -> Shell:
        """Build a tube from the waist to a hem, its ease in heights at both."""
        tube, h = self.take("helper-skirt"), self.measures.height_m
        z = tube.vertices[:, 2]
        shell = clip_shell(tube, np.minimum(z - hem_z, self._waist_z - z))
        down = (self._waist_z - shell.vertices[:, 2]) / (self._waist_z - hem_z)
        return self._finish(shell, (ease[0] + (ease[1] - ease[0]) * down) * h, "skirt", 8)

    def _build_shoes(self) -> Shell:
        h, tights = self.measures.height_m, self.take("helper-tights")
        top = self._ankle_z + 0.022 * h
        shell = clip_shell(tights, np.where(_is_arm(tights), -_FAR, top - tights.vertices[:, 2]))
        return self._finish(shell, np.full(len(shell.vertices), 0.004 * h), "shoe", 3)

    def _build_skin(self, looks: PedestrianAppearance) -> Shell:
        """Build the skin not covered by garments, and a strip below their hems."""
        body = self.take("body")
        shoes = np.where(_is_arm(body), -_FAR, self._ankle_z - body.vertices[:, 2])
        covers = self._cover_top(body, looks), self._cover_bottom(body, looks), shoes
        bare = _OVERLAP_M - np.maximum.reduce(covers)
        if looks.top == "coat":
            is_leg = body.weights[:, _LEG_BONES].sum(axis=1) > 0.5
            bare = np.where(is_leg, np.minimum(bare, self._measure_coat(body)), bare)
        return simplify_shell(clip_shell(body, bare), _TRIANGLES["skin"])

    def _measure_scalp(self, shell: Shell) -> Float64Array:
        """Measure how far (n,) vertices are inside the hair line: high in front, low behind."""
        head = self.measures.crown_z - self.measures.chin_z
        up = (shell.vertices[:, 2] - self.measures.chin_z) / head
        eye = self.measures.joints["eye"]
        back = (eye[0] - shell.vertices[:, 0]) / head
        line = np.interp(back, *_HAIR_LINE)
        is_head = shell.weights[:, Bone.HEAD] > 0.5
        return np.where(is_head, (up - line) * head, -_FAR)

    def _build_head_wear(self, looks: PedestrianAppearance) -> list[tuple[Shell, str]]:
        """Build hair, with a hat over it, or a hood of the top."""
        if looks.hair == "bald":
            return []
        if looks.hair == "hood":
            return [(self._cover_head(0.03, 0.016), ACTOR_PAINT)]
        worn = [(self._cover_head(0.0, 0.012), f"hair_{looks.hair_colour}")]
        if looks.hair == "hat":
            cap = join_shells(self._cover_head(0.02, 0.017, above=0.75), self._build_brim())
            worn.append((cap, f"cloth_{looks.bag_colour}"))
        if looks.hair == "long":
            worn.append((self._build_hanging_hair(), worn[0][1]))
        if looks.hair == "bun":
            worn.append((self._build_bun(), worn[0][1]))
        return worn

    def _cover_head(self, lower: float, ease: float, above: float = 0.0) -> Shell:
        """Build a cap over the scalp, `ease` in heights off it and thin at its edge.

        `lower` moves its edge down the face, in heights; `above` cuts it at a fraction of the head.
        """
        h, body = self.measures.height_m, self.take("body")

        def measure(shell: Shell) -> Float64Array:
            inside = self._measure_scalp(shell) + lower * h
            return np.minimum(inside, shell.vertices[:, 2] - self._find_head_z(above))

        shell = clip_shell(body, measure(body))
        rise = ease * h * np.clip(measure(shell) / (0.015 * h), 0.15, 1.0)
        return self._finish(shell, rise, "hair", 10)

    def _find_head_z(self, part: float) -> float:
        """Find the height of a fraction of the head, from the chin up."""
        return self.measures.chin_z + part * (self.measures.crown_z - self.measures.chin_z)

    def _build_face(self, looks: PedestrianAppearance) -> list[tuple[Shell, str]]:
        """Build eyes with irises, brows and lips."""
        eyes = [self.take(group) for group in ("helper-l-eye", "helper-r-eye")]
        irises = [clip_shell(eye, _measure_iris(eye)) for eye in eyes]
        iris = join_shells(*(_move_ahead(iris, 0.001) for iris in irises))
        brow = "hair_grey" if looks.hair_colour == "grey" else "hair_black"
        if looks.hair_colour in ("blond", "red"):
            brow = "hair_brown"
        return [
            (simplify_shell(join_shells(*eyes), _TRIANGLES["eyes"]), "cloth_white"),
            (simplify_shell(iris, _TRIANGLES["eyes"]), "hair_black"),
            (self._build_patch("eye", (0.0216, 0.0046), 0.0158, 0.45), brow),
            (self._build_patch("mouth", (0.023, 0.0075), -0.040, 0.0), _LIP_MATERIALS[looks.skin]),
        ]

    def _build_patch(
        self, joint: str, radii: tuple[float, float], rise: float, inward: float
    ) -> Shell:
        """Build a thin patch on the face around a joint and its mirror image, in metres of adults.

        `rise` is above the joint; it is lower outwards by `inward` of its half width.
        """
        body, centre = self.take("body"), self.measures.joints[joint]
        unit = (self.measures.crown_z - self.measures.chin_z) / 0.225
        across = (np.abs(body.vertices[:, 1]) - abs(centre[1])) / (radii[0] * unit)
        up = (body.vertices[:, 2] - centre[2] - rise * unit) / (radii[1] * unit)
        ahead = body.vertices[:, 0] - centre[0] + 0.02 * unit
        field = np.minimum(1.0 - across**2 - (up + inward * across**2) ** 2, ahead / unit * 100)
        field = np.where(body.weights[:, Bone.HEAD] > 0.5, field, -1.0)
        patch = clip_shell(body, field)
        lifted = patch.vertices + 0.0012 * unit * patch.compute_normals()
        return simplify_shell(replace(patch, vertices=lifted), _TRIANGLES["patch"])

    def _build_hanging_hair(self) -> Shell:
        """Build long hair behind the neck; it turns with the head."""
        h, neck = self.measures.height_m, self.measures.joints["neck"]
        top = np.array([self.measures.joints["head"][0] - 0.03 * h, 0.0, self._find_head_z(0.54)])
        middle = 0.5 * (top + neck) + (-0.022 * h, 0.0, -0.005 * h)
        radii = (0.022 * h, 0.046 * h, 0.5 * (top[2] - neck[2]) + 0.035 * h)
        return _build_cushion(middle, radii, Bone.HEAD, 0.7)

    def _build_bun(self) -> Shell:
        h = self.measures.height_m
        at = np.array([self._back_of_head_x - 0.004 * h, 0.0, self._find_head_z(0.77)])
        return _build_cushion(at, (0.02 * h, 0.022 * h, 0.022 * h), Bone.HEAD, 1.0)

    def _build_brim(self) -> Shell:
        h, eye = self.measures.height_m, self.measures.joints["eye"]
        at = np.array([eye[0] + 0.018 * h, 0.0, self._find_head_z(0.77)])
        return _build_cushion(at, (0.032 * h, 0.035 * h, 0.004 * h), Bone.HEAD, 0.8)

    @property
    def _back_of_head_x(self) -> float:
        body = self.take("body")
        return float(body.vertices[body.weights[:, Bone.HEAD] > 0.9, 0].min())

    def _build_bag(self, looks: PedestrianAppearance) -> list[tuple[Shell, str]]:
        """Build a backpack with straps, a bag at the hip, or a case in the right hand."""
        h, joints = self.measures.height_m, self.measures.joints
        material = f"cloth_{looks.bag_colour}"
        if looks.bag == "backpack":
            back = self._find_back_x(joints["shoulder"][2] - 0.06 * h)
            at = np.array([back - 0.045 * h, 0.0, joints["shoulder"][2] - 0.085 * h])
            return [
                (_build_cushion(at, (0.05 * h, 0.085 * h, 0.13 * h), Bone.TRUNK, 0.5), material)
            ]
        if looks.bag == "shoulder_bag":
            at = np.array([-0.01 * h, self._find_side_y(self._hip_z) + 0.022 * h, self._hip_z])
            radii = (0.075 * h, 0.022 * h, 0.06 * h)
            return [(_build_cushion(at, radii, Bone.TRUNK, 0.5), material)]
        if looks.bag == "case":
            hand, elbow = (joints[name] * (1, -1, 1) for name in ("hand", "elbow"))
            along = (hand - elbow) / np.sqrt(((hand - elbow) ** 2).sum())
            at = hand + (0.05 + 0.085) * h * along
            return [
                (
                    _build_cushion(
                        at,
                        (0.11 * h, 0.022 * h, 0.075 * h),
                        bone_on_side(Bone.FOREARM, -1),
                        0.4,
                    ),
                    material,
                )
            ]
        return []

    def _find_back_x(self, z: float) -> float:
        tights = self.take("helper-tights")
        near = (np.abs(tights.vertices[:, 2] - z) < 0.03) & ~_is_arm(tights)
        return float(tights.vertices[near, 0].min())

    def _find_side_y(self, z: float) -> float:
        tights = self.take("helper-tights")
        near = (np.abs(tights.vertices[:, 2] - z) < 0.03) & ~_is_arm(tights)
        return float(tights.vertices[near, 1].max())


def _is_arm(shell: Shell) -> NDArray[np.bool_]:
    return shell.weights[:, _ARM_BONES].sum(axis=1) > 0.5


def _measure_iris(eye: Shell) -> Float64Array:
    """Measure how far (n,) vertices of an eye are inside its iris, which looks ahead."""
    low, high = eye.vertices[:, 0].min(), eye.vertices[:, 0].max()
    return eye.vertices[:, 0] - high + 0.07 * (high - low)


def _move_ahead(shell: Shell, distance_m: float) -> Shell:
    return replace(shell, vertices=shell.vertices + xyz(distance_m))


def _build_cushion(
    centre: Float64Array, radii: tuple[float, float, float], bone: int, roundness: float
) -> Shell:
    """Build a solid on one bone: an ellipsoid with roundness 1, nearly a box with less."""
    ball = ellipsoid((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), sides=16, bands=10)
    squared = np.sign(ball.vertices) * np.abs(ball.vertices) ** roundness
    weights = np.zeros((len(squared), len(BONE_SIDES)))
    weights[:, bone] = 1.0
    vertices = np.round(squared * radii + centre, SNAP_DECIMALS)
    return Shell(vertices, ball.triangles, weights)
