"""Reflection by a surface: a diffuse base under a dielectric coat, or metal.

A coat reflects by Fresnel's equations from facets of a GGX distribution. Light that passes it twice
is reflected by the base. The factors of both passages are relative to their means, since the albedo
of a base is given for the coated surface.
"""

from dataclasses import dataclass
from typing import Any

from advercity.physics import water
from advercity_mitsuba.variant import dr, mi

GLASS_INDEX, GLASS_TRANSMITTANCE = 1.52, 0.72
"""Index of a tinted pane, and its transmittance besides the reflections of both faces."""
VARNISH_INDEX, VARNISH_EXTERNAL_REFLECTANCE = 1.5, 0.0918
"""Index of varnish and plastics, and their reflectance for diffuse light from outside."""
LEAST_COSINE = 1e-3


@dataclass
class Surface:
    """Optical properties at points of surfaces.

    Attributes:
        albedo: Diffuse, linear sRGB.
        alpha: Width of the specular lobe (GGX).
        coat: Fraction covered by a dielectric layer.
        index: Refractive index of the layer.
        metal: Reflectance at normal incidence.
        normal: Unit vector, world frame.
        through: Diffuse light to the other side, relative to the reflected light.
    """

    albedo: Any
    alpha: Any
    coat: Any
    index: Any
    metal: Any
    normal: Any
    through: Any


def fresnel(index: Any, cosine: Any) -> Any:
    """Compute the reflectance of a dielectric for unpolarised light."""
    c = dr.clip(cosine, 0.0, 1.0)
    g = dr.sqrt(index * index - 1.0 + c * c)
    a, b = (g - c) / (g + c), (c * (g + c) - 1.0) / (c * (g - c) + 1.0)
    return 0.5 * a * a * (1.0 + b * b)


def compute_specular_reflectance(s: Surface, cosine: Any) -> Any:
    """Compute the reflectance of a facet; of metals by Schlick's approximation."""
    m = dr.clip(1.0 - cosine, 0.0, 1.0)
    metal = s.metal + dr.select(dr.max(s.metal) > 0.0, (1.0 - s.metal) * m**5, 0.0)
    return mi.Color3f(s.coat * fresnel(s.index, cosine)) + metal


def _coat_transmittance(s: Surface, cosine: Any) -> Any:
    """Compute the transmittance of the coat at an angle, relative to its mean over all angles."""
    water_index, mean = water.WATER_REFRACTIVE_INDEX, water.DIFFUSE_EXTERNAL_REFLECTANCE
    of_varnish = (s.index - water_index) / (VARNISH_INDEX - water_index)
    mean = dr.lerp(mean, VARNISH_EXTERNAL_REFLECTANCE, of_varnish)
    return (1.0 - s.coat * fresnel(s.index, cosine)) / (1.0 - s.coat * mean)


def evaluate_diffuse(s: Surface, towards_eye: Any, towards_light: Any) -> Any:
    """Evaluate the diffuse part of the BRDF times the cosine of incidence."""
    nl = dr.dot(s.normal, towards_light)
    passes = _coat_transmittance(s, nl) * _coat_transmittance(s, dr.dot(s.normal, towards_eye))
    return s.albedo * dr.inv_pi * dr.select(nl > 0.0, nl * passes, -nl * s.through)


def evaluate_specular(s: Surface, towards_eye: Any, towards_light: Any) -> Any:
    """Evaluate the specular BRDF times the cosine, with height-correlated Smith shadowing."""
    nl = dr.dot(s.normal, towards_light)
    half = dr.normalize(towards_eye + towards_light)
    nh = dr.maximum(dr.dot(s.normal, half), 0.0)
    nv = dr.maximum(dr.dot(s.normal, towards_eye), LEAST_COSINE)
    a2 = s.alpha * s.alpha
    d = nh * nh * (a2 - 1.0) + 1.0
    smith = nl * dr.sqrt(nv * nv * (1.0 - a2) + a2) + nv * dr.sqrt(nl * nl * (1.0 - a2) + a2)
    lobe = a2 * nl * 0.5 / (dr.pi * d * d * smith)
    reflected = compute_specular_reflectance(s, dr.dot(towards_eye, half))
    return reflected * dr.select(nl > 0.0, lobe, 0.0)


def evaluate(s: Surface, towards_eye: Any, towards_light: Any) -> Any:
    """Evaluate the BRDF times the cosine of incidence."""
    diffuse = evaluate_diffuse(s, towards_eye, towards_light)
    return diffuse + evaluate_specular(s, towards_eye, towards_light)


def sample_bounce(s: Surface, ray: Any, random: Any) -> tuple[Any, Any, Any]:
    """Draw the next direction of a path along `ray`.

    Returns:
        The direction, the factor of its light, and whether the specular lobe was drawn.
    """
    towards_eye = -ray
    nv = dr.maximum(dr.dot(s.normal, towards_eye), LEAST_COSINE)
    coat = compute_specular_reflectance(s, nv).y
    chance = dr.clip(coat / dr.maximum(coat + s.albedo.y, 1e-4), 0.1, 1.0)
    chance = dr.select(coat > 1e-4, chance, 0.0)
    frame = mi.Frame3f(s.normal)
    mirrored = random.next_float32() < chance
    numbers = mi.Point2f(random.next_float32(), random.next_float32())

    diffuse = frame.to_world(mi.warp.square_to_cosine_hemisphere(numbers))
    both = 1.0 + s.through
    passes = random.next_float32() * both < s.through
    cosine = dr.dot(diffuse, s.normal)
    base = s.albedo * (both * _coat_transmittance(s, nv) / (1.0 - chance))
    base *= dr.select(passes, 1.0, _coat_transmittance(s, cosine))
    diffuse = dr.select(passes, -diffuse, diffuse)

    facets = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, s.alpha, True)
    local = frame.to_local(towards_eye)
    local.z = dr.maximum(local.z, LEAST_COSINE)
    half = frame.to_world(facets.sample(dr.normalize(local), numbers)[0])
    mirror = 2.0 * dr.dot(towards_eye, half) * half - towards_eye
    nl = dr.dot(s.normal, mirror)
    a2 = s.alpha * s.alpha
    eye = dr.sqrt(nv * nv * (1.0 - a2) + a2)
    light = dr.sqrt(nl * nl * (1.0 - a2) + a2)
    shine = compute_specular_reflectance(s, dr.dot(towards_eye, half))
    shine *= nl * (nv + eye) / ((nl * eye + nv * light) * dr.maximum(chance, 1e-4))
    shine = dr.select(nl > 0.0, shine, 0.0)
    return (
        dr.normalize(dr.select(mirrored, mirror, diffuse)),
        dr.select(mirrored, shine, base),
        mirrored,
    )


def compute_pane_reflectance(cosine: Any) -> Any:
    """Compute the reflectance of a pane: each face reflects light passed by the other."""
    face = fresnel(mi.Float(GLASS_INDEX), dr.abs(cosine))
    return 2.0 * face / (1.0 + face)


def build_pane_face(normal: Any) -> Surface:
    """Build the outer face of panes, to mirror the sun."""
    none = mi.Color3f(0.0)
    return Surface(
        none, mi.Float(0.03), mi.Float(1.0), mi.Float(GLASS_INDEX), none, normal, mi.Float(0.0)
    )
