"""Lists what this system lacks to run advercity; silent, with exit code 0, if nothing.

Runs on the system's own Python, before anything is installed, hence without any package.
"""

import ctypes
import sys
from collections.abc import Iterator

LIBRARIES = ("libatomic.so.1", "libGL.so.1", "libX11.so.6", "libXext.so.6", "libXrender.so.1")
"""Shared objects that SUMO and SAPIEN link to and their wheels do not contain."""

RAY_TRACING = b"VK_KHR_ray_tracing_pipeline"


class InstanceCreateInfo(ctypes.Structure):
    """`VkInstanceCreateInfo` of the Vulkan specification; zeros: no layers, no extensions."""

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


def find_missing() -> Iterator[str]:
    """Describe each missing requirement in a line."""
    for name in LIBRARIES:
        if not is_loadable(name):
            yield f"shared library {name}"
    if not (is_loadable("libvulkan.so.1") and has_ray_tracing(ctypes.CDLL("libvulkan.so.1"))):
        yield "a Vulkan device with ray tracing (a GPU, or Mesa's software driver from 25 on)"


def is_loadable(name: str) -> bool:
    """Whether the dynamic linker finds a shared library."""
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


def has_ray_tracing(vulkan: ctypes.CDLL) -> bool:
    """Whether any Vulkan device of this machine has ray-tracing pipelines."""
    instance = ctypes.c_void_p()
    # 1 is VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO.
    instance_info = InstanceCreateInfo(structure_type=1)
    if vulkan.vkCreateInstance(ctypes.byref(instance_info), None, ctypes.byref(instance)) != 0:
        return False
    count = ctypes.c_uint32()
    # As usual in Vulkan: the first call gives the number, the second fills the array.
    vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    devices = (ctypes.c_void_p * count.value)()
    vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), devices)
    found = any(RAY_TRACING in list_device_extensions(vulkan, device) for device in devices)
    vulkan.vkDestroyInstance(instance, None)
    return found


def list_device_extensions(vulkan: ctypes.CDLL, device: int | None) -> set[bytes]:
    """List the names of a physical device's extensions."""
    handle, count = ctypes.c_void_p(device), ctypes.c_uint32()
    vulkan.vkEnumerateDeviceExtensionProperties(handle, None, ctypes.byref(count), None)
    properties = (ExtensionProperties * count.value)()
    vulkan.vkEnumerateDeviceExtensionProperties(handle, None, ctypes.byref(count), properties)
    return {extension.name for extension in properties}


if __name__ == "__main__":
    lacking = list(find_missing())
    for line in lacking:
        print(f"missing: {line}", file=sys.stderr)
    sys.exit(1 if lacking else 0)
