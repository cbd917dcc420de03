"""The one place that starts Taichi. Import `ti` from here.

It is Quadrants, the fork of Taichi that is kept alive: the same language under a newer LLVM.
"""

import contextlib
import ctypes
import hashlib
import inspect
import io
import os
import tempfile
from pathlib import Path

os.environ.setdefault("ENABLE_QUADRANTS_HEADER_PRINT", "0")  # before the import: it prints to standard output
os.environ.setdefault("QD_ENABLE_PYBUF", "0")  # or it complains of a standard output that is not a file
# Of each function it is asked whether its source's caller is a class. That is the import system, whose source
# would be sought in all modules every time: a third of every start.
inspect.modulesbyfile["<frozen importlib._bootstrap>"] = "importlib._bootstrap"  # type: ignore[attr-defined]

import quadrants as ti
from quadrants.lang import impl
from quadrants.lang._func_base import FuncBase

SOURCES = Path(__file__).parent


def _cache() -> dict[str, object]:
    """Where compiled kernels are kept: a folder of their own for each state of these sources.

    A kernel is found again by its own source and its arguments (`fastcache`), which say nothing of the
    constants that it takes from its module; the folder's name does. Where nothing may be written, nothing is
    kept, but Taichi ends the process where it cannot make its folder, so that it makes one that stays empty.
    """
    digest = hashlib.sha256()
    for path in sorted(SOURCES.rglob("*.py")):
        digest.update(path.relative_to(SOURCES).as_posix().encode() + b"\0" + path.read_bytes())
    with contextlib.suppress(OSError, RuntimeError):  # RuntimeError: there is no home
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = home / "dlolib" / digest.hexdigest()[:16]
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return {"offline_cache": True, "offline_cache_file_path": str(folder)}
    empty = Path(tempfile.gettempdir()) / f"dlolib-{os.getuid()}"
    return {"offline_cache": False, "src_ll_cache": False, "offline_cache_file_path": str(empty)}


# Double precision, and no fast maths: an error of the compiler must not be taken for physics, and two
# runs must agree to the byte. Without Taichi's own advanced passes (LLVM's remain) the first start takes a
# quarter of the time, and a step a tenth longer.
with contextlib.redirect_stdout(io.StringIO()):  # it announces itself where a command's output goes
    ti.init(
        arch=ti.cpu,
        default_fp=ti.f64,
        default_ip=ti.i32,
        fast_math=False,
        advanced_optimization=False,
        log_level=ti.WARN,
        **_cache(),
    )

# A roll-out's arrays are some MB each. The C library would hand them back to the system after every call and
# ask for them again at the next, page by page: an eighth of the time of a fit.
MMAP_THRESHOLD, TRIM_THRESHOLD = -3, -1
with contextlib.suppress(AttributeError, OSError, TypeError):  # where the C library is another
    ctypes.CDLL(None).mallopt(MMAP_THRESHOLD, 2**25)
    ctypes.CDLL(None).mallopt(TRIM_THRESHOLD, 2**28)


def _tree_and_context(self, *args, ast_builder=None, make=FuncBase.get_tree_and_ctx, **kwargs):
    """Taichi's own, with the builder of what is compiled: it gives inlined functions the kernel's."""
    if ast_builder is not None:
        ast_builder = impl.get_runtime().compiling_callable.ast_builder()
    return make(self, *args, ast_builder=ast_builder, **kwargs)


# Else a function inlined into a real one, which is compiled once and called, must not have an `if`.
FuncBase.get_tree_and_ctx = _tree_and_context

vec2 = ti.types.vector(2, ti.f64)
vec3 = ti.types.vector(3, ti.f64)
vec4 = ti.types.vector(4, ti.f64)
# So many columns of derivatives are computed with together: LLVM makes vector instructions of it.
LANES = 4
lanes = ti.types.vector(LANES, ti.f64)
mat2 = ti.types.matrix(2, 2, ti.f64)
mat3 = ti.types.matrix(3, 3, ti.f64)

# Taichi gives a core no fewer than 512 iterations of a kernel's outer loop. A loop over ropes runs so many
# for each and does the first, a loop over steps fewer; else two ropes would share a core, the other at rest.
APART, NEAR = 512, 32

__all__ = ["APART", "LANES", "NEAR", "impl", "lanes", "mat2", "mat3", "ti", "vec2", "vec3", "vec4"]
