"""Capabilities and errors of the backend, and its release of memory."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from advercity_sapien import SapienBackend
from advercity_sapien.backend import VulkanDevice, find_vulkan_device

from advercity.errors import BackendError
from advercity.frames import Frame
from advercity.geometry.mesh import Mesh
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.extinction import AirExtinction
from advercity.physics.sky import build_airlight_cubemap
from advercity.physics.weather_parts.part import Extinction, Suspension
from advercity.rendering.backend import CameraView, RenderProfile, load_backend
from advercity.semantics import Semantic
from advercity.world import World

RASTER = RenderProfile("raster", 1.0, "raster")
RAY_TRACED = RenderProfile("traced", 1.0, "ray_traced")


def world_of(triangles: int) -> World:
    rng = np.random.default_rng(1)
    places = rng.uniform(5.0, 50.0, size=(triangles, 1, 3))
    corners = places + rng.normal(scale=0.01, size=(triangles, 3, 3))
    mesh = Mesh(
        "soup",
        corners.reshape(-1, 3).astype(np.float32),
        np.arange(triangles * 3, dtype=np.int32).reshape(-1, 3),
        "concrete",
        Semantic.BUILDING,
    )
    return World("soup", (mesh,), bodies={}, lanes=(), network=Path("none"))


AIR = Atmosphere(
    extinction=AirExtinction((Suspension("air", Extinction(1e-4, 1e-4)),)),
    sun_direction=np.array([0.0, 0.0, 1.0]),
    sun_lx=1e4,
    sun_colour=(1.0, 1.0, 1.0),
    sky_lx=3e3,
    sky=np.full((6, 4, 4, 3), 1e3, dtype=np.float32),
    airlight=build_airlight_cubemap((1e3, 1e3, 1e3), (1e3, 1e3, 1e3)),
    street_lx=0.0,
    wetness=0.0,
    puddle_coverage=0.0,
    night=False,
)
VIEW = CameraView(np.eye(4), 32, 24, 1.5)


@pytest.mark.render
def test_it_is_found_by_name_and_knows_its_device() -> None:
    backend = load_backend("sapien")
    capabilities = backend.capabilities()
    assert backend.name == "sapien"
    assert capabilities.device
    assert capabilities.participating_medium
    assert capabilities.deterministic == ("llvmpipe" in capabilities.device)


def test_without_vulkan_it_says_what_to_install() -> None:
    code = """
from advercity.errors import BackendError
from advercity_sapien import SapienBackend
try:
    SapienBackend().capabilities()
except BackendError as error:
    print(error)
"""
    nowhere = {"VK_DRIVER_FILES": "/nonexistent.json", "VK_ICD_FILENAMES": "/nonexistent.json"}
    child = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | nowhere,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "no Vulkan device" in child.stdout
    assert "make setup" in child.stdout
    assert "Traceback" not in child.stdout + child.stderr


def test_a_probe_of_vulkan_that_is_killed_names_the_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    crash = "import os; os.kill(os.getpid(), 11)"
    monkeypatch.setattr("advercity_sapien.backend.PROBE_SCRIPT", crash)
    find_vulkan_device.cache_clear()
    with pytest.raises(BackendError, match=r"no Vulkan device \(killed by SIGSEGV"):
        find_vulkan_device()


def test_without_ray_tracing_only_raster_profiles_open(monkeypatch: pytest.MonkeyPatch) -> None:
    old = VulkanDevice("llvmpipe (old)", is_cuda=False, supports_ray_tracing=False)
    monkeypatch.setattr("advercity_sapien.backend.find_vulkan_device", lambda: old)
    assert not SapienBackend().capabilities().ray_traced
    with (
        pytest.raises(BackendError, match="'traced' requires ray tracing, which llvmpipe"),
        SapienBackend().open(world_of(1), AIR, RAY_TRACED),
    ):
        pass


@pytest.mark.render
@pytest.mark.parametrize("profile", [RASTER, RAY_TRACED], ids=lambda profile: profile.name)
def test_closed_renderers_and_taken_pictures_leave_no_memory_behind(profile: RenderProfile) -> None:
    world = world_of(20_000)  # some 5 MB on the device, and as much again for tracing

    def once() -> int:
        with SapienBackend().open(world, AIR, profile) as renderer:
            for index in range(5):
                renderer.place(Frame(index, 0.0, (), {}))
                renderer.render_camera(VIEW)
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    # The allocator's arenas grow in a few large jumps before they are used again; a leaked renderer
    # would add to every round, so memory would never stand still over several of them.
    used = [once() for _ in range(5)]
    while used[-1] - used[-5] > 4e6 and len(used) < 60:
        used.append(once())
    assert used[-1] - used[-5] <= 4e6


def test_settings_of_the_software_driver_do_not_change_images(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The driver reads them when it opens a device, which this process may have done already."""
    monkeypatch.setenv("GALLIVM_PERF", "no_filter_hacks,nopt")
    SapienBackend().capabilities()
    assert os.environ["GALLIVM_PERF"] == "nopt"
