"""Tell what this system lacks to run advercity; silent, with exit code 0, if nothing.

Runs on the system's own Python, before anything is installed, hence without any package.
"""

import ctypes
import sys
from collections.abc import Iterator

LIBRARIES = ("libatomic.so.1", "libGL.so.1", "libX11.so.6", "libXext.so.6", "libXrender.so.1")
"""Shared objects that SUMO and SAPIEN link to and their wheels do not carry."""

RAY_TRACING = b"VK_KHR_ray_tracing_pipeline"


class InstanceCreateInfo(ctypes.Structure):
    """`VkInstanceCreateInfo` of the Vulkan specification; zeros ask for no layer, no extension."""

    _fields_ = (
        ("structure_type", ctypes.c_uint32),
        ("next", ctypes.c_void_p),
        ("flags", ctypes.c_uint32),
        ("application_info", ctypes.c_void_p),
        ("layer_count", ctypes.c_uint32),
        ("layer_names", ctypes.c_void_p),
        ("extension_count", ctypes.c_uint32),
        ("extension_names", ctypes.c_void_p),
    )


class ExtensionProperties(ctypes.Structure):
    """`VkExtensionProperties` of the Vulkan specification."""

    _fields_ = (("name", ctypes.c_char * 256), ("version", ctypes.c_uint32))


def missing() -> Iterator[str]:
    """Say what lacks, one line each."""
    for name in LIBRARIES:
        if not loads(name):
            yield f"shared library {name}"
    if not (loads("libvulkan.so.1") and traces_rays(ctypes.CDLL("libvulkan.so.1"))):
        yield "a Vulkan device that traces rays (a GPU's, or Mesa's software driver from 25 on)"


def loads(name: str) -> bool:
    """Whether the dynamic linker finds a shared library."""
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


def traces_rays(vulkan: ctypes.CDLL) -> bool:
    """Whether any Vulkan device of this machine has ray-tracing pipelines."""
    instance = ctypes.c_void_p()
    wanted = InstanceCreateInfo(structure_type=1)
    if vulkan.vkCreateInstance(ctypes.byref(wanted), None, ctypes.byref(instance)) != 0:
        return False
    count = ctypes.c_uint32()
    vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    devices = (ctypes.c_void_p * count.value)()
    vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), devices)
    found = any(RAY_TRACING in extensions(vulkan, device) for device in devices)
    vulkan.vkDestroyInstance(instance, None)
    return found


def extensions(vulkan: ctypes.CDLL, device: int | None) -> set[bytes]:
    """Give the names of a physical device's extensions."""
    handle, count = ctypes.c_void_p(device), ctypes.c_uint32()
    vulkan.vkEnumerateDeviceExtensionProperties(handle, None, ctypes.byref(count), None)
    properties = (ExtensionProperties * count.value)()
    vulkan.vkEnumerateDeviceExtensionProperties(handle, None, ctypes.byref(count), properties)
    return {extension.name for extension in properties}


if __name__ == "__main__":
    lacking = list(missing())
    for line in lacking:
        print(f"missing: {line}", file=sys.stderr)
    sys.exit(1 if lacking else 0)
