"""The one door to Open3D, which fails to load where the system lacks libusb-1.0.

The PyPI package `libusb-package` carries that library: loaded first and globally, Open3D finds it
without a system package. Its messages are turned down to errors, since ours name file, place and mend.
"""

from __future__ import annotations

import ctypes


def _preload_libusb() -> None:
    try:
        ctypes.CDLL("libusb-1.0.so.0", ctypes.RTLD_GLOBAL)
    except OSError:
        import libusb_package

        path = libusb_package.get_library_path()
        if path is not None:
            ctypes.CDLL(str(path), ctypes.RTLD_GLOBAL)


_preload_libusb()

import open3d  # noqa: E402

open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)

__all__ = ["open3d"]
