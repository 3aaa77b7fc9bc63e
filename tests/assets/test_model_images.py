"""Images of foreign models: where they belong, to scale, around the colour of the table."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from advercity_dsl import Blueprint, Spec
from advercity_dsl.catalogue import BodyModel
from numpy.typing import NDArray
from PIL import Image
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from advercity.assets.bodies import build_body
from advercity.assets.model_files import ModelPart
from advercity.assets.model_images import (
    ModelImage,
    find_images_file,
    pack_images,
    project_images,
    read_images,
)
from advercity.assets.model_store import ModelStore, open_model_store
from advercity.compiler import with_digest
from advercity.errors import RunError
from advercity.geometry.arrays import Float64Array
from advercity.pipeline import RunOptions, run_scenario
from advercity.testing import with_small_sensors

RED, BLUE = (200, 40, 40), (20, 40, 180)


def two_colours() -> NDArray[np.uint8]:
    """An image whose left half is red, and whose right half is blue."""
    image = np.zeros((64, 64, 3), dtype=np.uint8)
    image[:, :32], image[:, 32:] = RED, BLUE
    return image


def grid(count: int, size_m: float) -> tuple[Float64Array, NDArray[np.int64]]:
    """A level square of count x count cells of two triangles each, at the origin."""
    steps = np.linspace(0.0, size_m, count + 1)
    vertices = np.array([(x, y, 0.0) for y in steps for x in steps])
    corner = np.array([row * (count + 1) + col for row in range(count) for col in range(count)])
    across = count + 1
    lower = np.stack([corner, corner + 1, corner + across + 1], axis=1)
    upper = np.stack([corner, corner + across + 1, corner + across], axis=1)
    return vertices, np.concatenate([lower, upper])


def square(
    material: str, count: int, image: NDArray[np.uint8] | None, x_m: float = 0.0
) -> ModelPart:
    """A square of 2 m that an image covers."""
    vertices, triangles = grid(count, 2.0)
    uv = vertices[triangles][..., :2] / 2.0
    return ModelPart(material, vertices + np.array([x_m, 0.0, 0.0]), triangles, image=image, uv=uv)


def colours_at(image: ModelImage, part: int, places: Float64Array) -> NDArray[np.uint8]:
    """Colours (m, n, 3) at barycentric places (n, 3) of the triangles of a part."""
    width = image.maps.color.shape[1]
    at = np.einsum("nk,mkd->mnd", places, image.uv[part]) / image.maps.tile_m
    return image.maps.color[(-at[..., 1] * width).astype(int), (at[..., 0] * width).astype(int)]


def test_a_triangle_of_a_simpler_part_shows_the_image_of_where_it_is() -> None:
    coarse = square("metal", 4, None)
    (image,) = project_images([coarse], [square("metal", 20, two_colours())])
    middle = np.full((1, 3), 1 / 3)
    found = colours_at(image, 0, middle)[:, 0]
    x = coarse.vertices[coarse.triangles].mean(axis=1)[:, 0]
    np.testing.assert_array_equal(found[x < 1.0], np.broadcast_to(RED, (16, 3)))
    np.testing.assert_array_equal(found[x > 1.0], np.broadcast_to(BLUE, (16, 3)))


def test_an_image_has_its_scale_and_the_mean_light_of_what_it_covers() -> None:
    (image,) = project_images([square("metal", 4, None)], [square("metal", 8, two_colours())])
    assert image.maps.tile_m == pytest.approx(2.0, rel=0.01)
    linear = [((np.array(c) / 255 + 0.055) / 1.055) ** 2.4 for c in (RED, BLUE)]
    assert image.maps.mean == pytest.approx(np.mean(linear, axis=0), rel=0.02)


def test_a_part_without_an_image_has_the_mean_of_those_with_one() -> None:
    sources = [square("metal", 8, two_colours()), square("metal", 8, None, x_m=10.0)]
    parts = [square("metal", 2, None), square("metal", 2, None, x_m=10.0)]
    (image,) = project_images(parts, sources)
    plain = colours_at(image, 1, np.eye(3)).reshape(-1, 3)
    light = ((plain / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(light, np.broadcast_to(image.maps.mean or 0, light.shape), rtol=0.03)


def test_paint_varies_in_tone_alone_and_panes_have_no_image() -> None:
    parts = [square(material, 2, None) for material in ("paint", "glass")]
    sources = [square(material, 4, two_colours()) for material in ("paint", "glass")]
    (image,) = project_images(parts, sources)
    assert list(image.uv) == [0]
    assert (np.ptp(image.maps.color, axis=2) == 0).all()


def test_a_users_model_keeps_the_image_of_its_file_and_its_triangles(tmp_path: Path) -> None:
    store = ModelStore(tmp_path / "store")
    bodies = [
        build_body("box", car(add_box(store, tmp_path, image)), store)
        for image in (None, two_colours())
    ]
    bare, own = ([m for m in body.parts if m.material == "metal"] for body in bodies)
    assert not bare[0].maps and own[0].maps and own[0].uv is not None
    np.testing.assert_allclose(
        np.sort(own[0].vertices[own[0].triangles].reshape(-1, 9), axis=0),
        np.sort(bare[0].vertices[bare[0].triangles].reshape(-1, 9), axis=0),
        atol=1e-6,
    )
    colours = store.images[own[0].maps].color.reshape(-1, 3)
    assert (colours == RED).all(axis=1).any() and (colours == BLUE).all(axis=1).any()


@pytest.mark.sumo
def test_a_scenario_is_not_continued_with_other_images_of_a_model(
    specs: dict[str, Spec], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ADVERCITY_DATA", str(tmp_path / "data"))
    store, compiled = open_model_store(), with_small_sensors(specs["rsnj_clear_day_sparse"])
    model = {"model": add_box(store, tmp_path, two_colours())}
    boxed = compiled.blueprints["seat_leon"].model_copy(update=model)
    models = {
        "blueprints": {**compiled.blueprints, "seat_leon": boxed},
        "assets": {"model/seat_leon": store.compute_model_digest(boxed)},
    }
    spec = with_digest(compiled.model_copy(update=models))
    options = RunOptions(tmp_path / "output", backend="fake", profile="preview", frames=slice(0, 1))
    run_scenario(spec, options)
    path = store.prepare_model(boxed)
    assert path is not None
    images = read_images(find_images_file(path))
    for image in images:
        image.maps.color[:] = 255 - image.maps.color
    find_images_file(path).write_bytes(pack_images(images))
    with pytest.raises(RunError, match=r"made from another spec, version or device \(world_sha256"):
        run_scenario(spec, replace(options, frames=slice(0, 2)))
    find_images_file(path).write_bytes(pack_images(images)[:500])
    with pytest.raises(RunError, match=r"\.npz: not a file of arrays"):
        run_scenario(spec, replace(options, frames=slice(0, 2)))
    find_images_file(path).unlink()
    run_scenario(spec, replace(options, frames=slice(0, 2)))


def test_a_file_of_other_arrays_is_no_images_of_a_model(tmp_path: Path) -> None:
    path = tmp_path / "other.npz"
    np.savez(path, count=np.array(1))
    with pytest.raises(RunError, match=r"not images of a model.*delete it, and it is made again"):
        read_images(path)


def car(model: BodyModel) -> Blueprint:
    return Blueprint(actor_class="car", length_m=4.2, width_m=1.8, height_m=1.5, model=model)


def add_box(store: ModelStore, folder: Path, image: NDArray[np.uint8] | None) -> BodyModel:
    """Store a box of 4.2 x 1.8 x 1.5 m as a GLB, with an image on it or not."""
    shape = trimesh.creation.box((4.2, 1.8, 1.5))
    if image is not None:
        material = PBRMaterial(name="metal", baseColorTexture=Image.fromarray(image))
        uv = shape.vertices[:, :2] / (4.2, 1.8) + 0.5
        shape.visual = TextureVisuals(uv=uv, material=material)
    path = folder / f"{image is None}.glb"
    content = trimesh.Scene({"metal": shape}).export(file_type="glb")
    assert isinstance(content, bytes)
    path.write_bytes(content)
    digest = store.add_model(path)
    return BodyModel(file=path.name, sha256=digest, up="z", author="Me", licence="MIT")
