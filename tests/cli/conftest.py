"""Settings that must stand before Taichi loads."""

from __future__ import annotations

import os

# Under pytest, sys.stdout is wrapped; Taichi would take it for a notebook and say so on standard error.
os.environ.setdefault("TI_ENABLE_PYBUF", "0")
