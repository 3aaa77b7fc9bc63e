"""Images of surfaces join their copies, have the albedo of the table, and are the same anywhere."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest

from advercity.assets.maps.catalogue import BAKED_SURFACES, bake_maps
from advercity.assets.maps.tile import Tile
from advercity.material_maps import MaterialMaps
from advercity.materials import MATERIALS

PIXELS = 256
DIGEST_PROGRAM = (
    "from tests.assets.test_maps import compute_digest; print(compute_digest(), end='')"
)


@pytest.fixture(scope="module", params=list(BAKED_SURFACES))
def surface(request: pytest.FixtureRequest) -> tuple[str, MaterialMaps]:
    return request.param, bake_maps(request.param, PIXELS)


def test_every_surface_of_the_material_table_is_baked():
    named = {material.maps for material in MATERIALS.values() if material.maps}
    assert named <= set(BAKED_SURFACES)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_surface_joins_its_copies_without_a_seam(surface: tuple[str, MaterialMaps], axis: int):
    _, maps = surface
    for image in (maps.color, maps.normal, maps.roughness):
        assert image is not None
        steps = np.abs(np.diff(image.astype(float), axis=axis, append=image.take([0], axis)))
        steps = steps.reshape(*steps.shape[:2], -1).mean(axis=(1 - axis, 2))
        # The seam is the last step; an edge of bricks or boards there is like any other.
        assert steps[-1] <= 1.3 * steps[:-1].max() + 0.5


def test_a_surface_has_the_mean_albedo_and_roughness_of_its_material(
    surface: tuple[str, MaterialMaps],
):
    name, maps = surface
    material = MATERIALS[BAKED_SURFACES[name].material]
    value = maps.color / 255
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    assert linear.mean(axis=(0, 1)) == pytest.approx(material.albedo, rel=0.01)
    assert maps.roughness is not None
    assert maps.roughness.mean() / 255 == pytest.approx(material.roughness, abs=0.005)


def test_normals_are_of_length_1_and_lean_to_no_side(surface: tuple[str, MaterialMaps]):
    _, maps = surface
    assert maps.normal is not None
    normal = maps.normal / 127.5 - 1
    assert np.linalg.norm(normal, axis=2) == pytest.approx(1, abs=0.02)
    assert normal[..., 2].min() > 0
    slopes = normal[..., :2] / normal[..., 2:]
    # A relief that joins its copies rises as much as it falls; single pixels of steep edges differ.
    assert np.abs(np.median(slopes, axis=(0, 1))).max() < 0.2


def test_relief_is_lit_from_the_side_that_it_faces():
    tile = Tile("slope", size_m=1.0, pixels=PIXELS)
    maps = bake_maps("brick", PIXELS)
    assert maps.normal is not None
    bricks = tile.lay(8, 24, 0.011)
    upper_edge = np.abs(bricks.y - 0.9) < 0.1
    assert maps.normal[upper_edge, 1].mean() > maps.normal[~upper_edge, 1].mean() + 3


def test_noise_has_waves_of_its_band_alone():
    noise = Tile("waves", size_m=2.0, pixels=PIXELS).noise("band", 0.5, 0.1)
    assert noise.mean() == pytest.approx(0, abs=1e-6)
    assert noise.std() == pytest.approx(1, rel=1e-4)
    power = np.abs(np.fft.rfft2(noise)) ** 2
    waves = np.hypot(np.fft.fftfreq(PIXELS, 1 / PIXELS)[:, None], np.arange(PIXELS // 2 + 1))
    wavelength_m = 2.0 / np.maximum(waves, 1e-9)
    outside = (wavelength_m > 1.01) | (wavelength_m < 0.07)
    assert power[outside].sum() < 1e-6 * power.sum()


def test_bricks_are_as_large_as_they_are_laid():
    # 4 columns and 8 rows on 2 m: 0.5 x 0.25 m, of which the joint takes 0.02 m.
    pieces = Tile("wall", size_m=2.0, pixels=512).lay(4, 8, 0.02, shift=0.5)
    assert len(np.unique(pieces.label)) == pieces.count == 32
    assert (pieces.edge_m > 0).mean() == pytest.approx(0.48 * 0.23 / (0.5 * 0.25), abs=0.02)
    assert pieces.edge_m.max() == pytest.approx(0.115, abs=0.004)


@pytest.mark.parametrize(
    ("name", "image", "across", "spacing_m"),
    [
        ("asphalt", "color", 0, 0.008),  # stones of SMA 8
        ("asphalt_new", "normal", 1, 0.008),
        ("brick", "color", 0, 1 / 12),  # courses of DIN 4172: twelve a metre
        ("brick_yellow", "color", 0, 1 / 12),
        ("paving", "color", 1, 0.5),
        ("concrete_panels", "color", 0, 2.0),
        ("roof_tile", "normal", 0, 1 / 3),  # twelve pantiles a square metre
        ("metal_sheet", "color", 1, 0.25),  # ribs of profile 35/250
    ],
)
def test_pieces_of_a_surface_are_as_far_apart_as_real_ones(
    name: str, image: str, across: int, spacing_m: float
):
    maps = bake_maps(name, 512)
    values = getattr(maps, image)[..., 1 - across].astype(float)
    power = np.abs(np.fft.rfft(values.mean(axis=1 - across)))
    assert maps.tile_m / (1 + power[1:].argmax()) == pytest.approx(spacing_m, rel=0.03)


def test_packed_pieces_go_on_at_the_opposite_edge():
    pieces = Tile("stones", size_m=1.0, pixels=PIXELS).pack("cells", 8)
    areas = np.bincount(pieces.label.ravel(), minlength=pieces.count)
    assert areas.min() > 0.2 * areas.mean()
    assert (pieces.label[0] == pieces.label[-1]).mean() > 0.8
    assert (pieces.label[:, 0] == pieces.label[:, -1]).mean() > 0.8


@pytest.mark.usefixtures("older_processor")
def test_images_do_not_depend_on_the_processor():
    done = subprocess.run(
        [sys.executable, "-c", DIGEST_PROGRAM], capture_output=True, text=True, check=True
    )
    assert done.stdout == compute_digest()


def compute_digest() -> str:
    digest = hashlib.sha256()
    for name in BAKED_SURFACES:
        maps = bake_maps(name, PIXELS)
        for image in (maps.color, maps.normal, maps.roughness):
            assert image is not None
            digest.update(image.tobytes())
    return digest.hexdigest()
