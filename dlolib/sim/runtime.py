"""The one place that starts Taichi. Import `ti` from here, never from taichi itself."""

import contextlib
import ctypes
import functools
import io
import os

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")  # before the import: it prints to standard output
os.environ.setdefault("TI_ENABLE_PYBUF", "0")  # or it complains of a standard output that is not a file

import taichi as ti
from taichi.lang import impl, kernel_impl
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

# Double precision, and no fast maths: an error of the compiler must not be taken for physics, and two
# runs must agree to the byte. The offline cache makes every start after the first quick; without Taichi's own
# advanced passes (LLVM's remain) the first takes 6 s instead of 40 s, and a step a tenth longer.
with contextlib.redirect_stdout(io.StringIO()):  # it announces itself where a command's output goes
    ti.init(
        arch=ti.cpu,
        default_fp=ti.f64,
        default_ip=ti.i32,
        fast_math=False,
        offline_cache=True,
        advanced_optimization=False,
        log_level=ti.WARN,
    )

# A roll-out's arrays are some MB each. The C library would hand them back to the system after every call and
# ask for them again at the next, page by page: an eighth of the time of a fit.
MMAP_THRESHOLD, TRIM_THRESHOLD = -3, -1
with contextlib.suppress(AttributeError, OSError, TypeError):  # where the C library is another
    ctypes.CDLL(None).mallopt(MMAP_THRESHOLD, 2**25)
    ctypes.CDLL(None).mallopt(TRIM_THRESHOLD, 2**28)


def _place(context, node):
    """Where a node of a kernel stands, for messages: the file and line, without a drawing of the source."""
    line = node.lineno + context.lineno_offset
    return f'File "{context.file}", line {line}, in {context.func.func.__name__}\n'


# Half of every start went into wrapping source lines for messages of errors that are not there.
ASTTransformerContext.get_pos_info = _place
# And a third of the rest into reading the same functions' source wherever they are called.
kernel_impl.getsourcelines = functools.cache(kernel_impl.getsourcelines)
kernel_impl.getsourcefile = functools.cache(kernel_impl.getsourcefile)
# And a tenth into asking of each function, by a look through all modules, whether it is in a class; none is.
kernel_impl._inside_class = lambda level_of_class_stackframe: False


def _tree_and_context(*args, ast_builder=None, make=kernel_impl._get_tree_and_ctx, **kwargs):
    """Taichi's own, with the builder of what is compiled: it gives inlined functions the kernel's."""
    if ast_builder is not None:
        ast_builder = impl.get_runtime().compiling_callable.ast_builder()
    return make(*args, ast_builder=ast_builder, **kwargs)


# Else a function inlined into a real one, which is compiled once and called, must not have an `if`.
kernel_impl._get_tree_and_ctx = _tree_and_context

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
