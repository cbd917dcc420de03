"""Kernels, launched at once.

Taichi asks of every argument of every launch which of a dozen things it may be; with thirty arguments that
takes as long as fifty steps of a rope. Kernels here take NumPy's arrays and numbers. What is as declared goes
straight to the compiled kernel, everything else through Taichi, which compiles it or says what is wrong.
"""

import functools
import warnings
from dataclasses import dataclass
from operator import index

import numpy as np

from dlolib.sim.runtime import impl, ti

DTYPES = {"f64": np.dtype(np.float64), "i32": np.dtype(np.int32)}
# Taichi counts entries in 32 bits.
MOST_ENTRIES = np.iinfo(np.int32).max


class Kernel:
    """A kernel without a result, compiled once for each choice of its templates."""

    def __init__(self, function):
        functools.update_wrapper(self, function)
        self._usual = ti.kernel(function, fastcache=True)
        self._compiled = {}
        declared = [one.annotation for one in self._usual._primal.arg_metas]
        self._templates = [k for k, one in enumerate(declared) if isinstance(one, ti.template)]
        passed = [k for k in range(len(declared)) if k not in self._templates]
        made = [_argument(place, k, declared[k]) for place, k in enumerate(passed)]
        self._arrays = [one for one in made if isinstance(one, _Array)]
        self._numbers = [one for one in made if isinstance(one, _Number)]

    def __call__(self, *args):
        choice = tuple(args[k] for k in self._templates)
        declared = all(one.fits(args[one.number]) for one in self._arrays)
        if not declared or choice not in self._compiled:
            with warnings.catch_warnings():
                # of the constants that it takes from its module; the cache's folder knows them (`runtime`)
                warnings.filterwarnings("ignore", message=r"\[PURE\.VIOLATION\]")
                self._usual(*args)
            if declared:
                self._compiled[choice] = self._as_compiled(args)
            return
        kernel, code = self._compiled[choice]
        context = kernel.make_launch_context()
        for one in self._arrays:
            array = args[one.number]
            shape = array.shape[: one.dimensions]
            context.set_arg_external_array_with_shape(one.place, array.ctypes.data, array.nbytes, shape, 0)
        for one in self._numbers:
            one.put(context, args[one.number])
        impl.get_runtime().prog.launch_kernel(code, context)

    def _as_compiled(self, args):
        """Taichi's kernel for these arguments, which it has just run, and its code."""
        primal = self._usual._primal
        return primal.materialized_kernels[primal.ensure_compiled(*args)], primal._last_compiled_kernel_data


@dataclass(frozen=True)
class _Array:
    """An array declared: its place among those passed, its number among all, its dimensions beside those of
    an entry, the entry's shape, and the type of its numbers."""

    place: int
    number: int
    dimensions: int
    entry: tuple
    dtype: np.dtype

    def fits(self, array):
        """Whether it is such an array, as the kernel reads it."""
        return (
            type(array) is np.ndarray
            and array.dtype is self.dtype
            and array.shape[self.dimensions :] == self.entry
            and array.ndim == self.dimensions + len(self.entry)
            and array.flags.c_contiguous
            and array.size <= MOST_ENTRIES
        )


@dataclass(frozen=True)
class _Number:
    """A number declared: likewise, and whether it is an integer."""

    place: int
    number: int
    whole: bool

    def put(self, context, value):
        if self.whole:
            context.set_arg_int(self.place, index(value))
        else:
            context.set_arg_float(self.place, float(value))


def _argument(place, number, declared):
    if not isinstance(declared, ti.types.ndarray):
        return _Number(place, number, declared is ti.i32)
    entry = declared.dtype
    shape = entry.get_shape() if hasattr(entry, "get_shape") else ()
    scalar = entry.dtype if shape else entry
    return _Array(place, number, declared.ndim, shape, DTYPES[scalar.to_string()])


def kernel(function):
    """As `ti.kernel`, of a function that returns nothing."""
    return Kernel(function)


__all__ = ["kernel"]
