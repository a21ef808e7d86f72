"""The private parts of Numba that the compiler is built on, each with its reason.

Numba promises none of them. Tried with 0.67.0 and 0.68.1. For another release these have to pass:
test_kernel.py, test_vectors.py, test_struct.py, test_kernel_cache.py, test_interpreted.py,
test_integrators.py.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from typing import Any

from llvmlite import binding as llvm
from numba import types

# Emits loops over the elements of tuples and arrays; numba.extending has no word for it.
from numba.core import cgutils

# Machine code is found by the hash of all sources, not by the place and age of one file.
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    NullCache,
    _CacheLocator,
)

# What is emitted for a function or a field of a type of ours, and whose references it counts.
from numba.core.imputils import (
    impl_ret_borrowed,
    lower_builtin,
    lower_getattr_generic,
    lower_setattr_generic,
)

# The class of a compiled function: Kernel tells vectors of different sizes apart. And how
# types lie in memory, for an image of it.
from numba.core.registry import CPUDispatcher, cpu_target

# Code that is loaded needs the run time alone, not the whole compiler.
from numba.core.runtime import rtsys

# Types of the fields of a Boxed, and of functions that have a Python body and code of ours.
from numba.core.typing.templates import (
    AbstractTemplate,
    AttributeTemplate,
    infer_getattr,
    infer_global,
)

# How a function by address lies in memory, for a type that is told apart by its arguments.
from numba.experimental.function_type import FunctionModel

# What kernels run for a function of numpy, by the types of its arguments.
from numba.np.ufunc_db import get_ufunc_info as loops_of

__all__ = [
    'AttributeTemplate', 'CPUDispatcher', 'CachedDispatcher', 'CompileResultCacheImpl',
    'FunctionCache', 'FunctionModel', 'IndexDataCacheFile', 'NullCache', '_CacheLocator',
    'address_of', 'bitcode_of', 'cgutils', 'cpu_target', 'impl_ret_borrowed', 'in_kernels',
    'infer_getattr', 'loaded_library', 'loops_of', 'lower_builtin', 'lower_getattr_generic',
    'lower_setattr_generic', 'rtsys', 'symbols_of',
]  # fmt: skip


class CachedDispatcher(CPUDispatcher):  # type: ignore[misc]
    """A compiled function with a cache of ours: Numba has no setting for its class.

    The cache is looked for when it is first asked for: most functions that are imported never are.
    """

    @functools.cached_property
    def _cache(self) -> Any:
        return self.cache()

    def cache(self) -> Any:
        """The cache."""
        raise NotImplementedError

    @classmethod
    def of(cls, compiled: Any) -> Any:
        """A compiled function as one of this class."""
        del compiled._cache  # Numba's own, which keeps nothing
        compiled.__class__ = cls
        return compiled


def address_of(compiled: Any) -> int:
    """Address of the machine code that Numba's first-class functions call."""
    name = compiled.fndesc.llvm_cfunc_wrapper_name
    return int(compiled.library.get_pointer_to_function(name))


def bitcode_of(compiled: Any) -> tuple[str, bytes]:
    """Name of a compiled function in LLVM, and the bitcode of all that it is made of."""
    module = compiled.library._get_module_for_linking()
    return str(compiled.fndesc.llvm_func_name), bytes(module.as_bitcode())


class _LaterModule:
    """Bitcode that is parsed when another function is compiled that calls this one.

    Few are: to parse the code of all that is loaded took a tenth of a start.
    """

    def __init__(self, bitcode: bytes) -> None:
        self._bitcode = bitcode

    @functools.cached_property
    def _module(self) -> Any:
        return llvm.parse_bitcode(self._bitcode)

    def clone(self) -> Any:
        """A module of LLVM to be linked into another."""
        return self._module.clone()

    def as_bitcode(self) -> bytes:
        """The bitcode."""
        return self._bitcode


def symbols_of(compiled: Any) -> list[str]:
    """Names of all that the code of a compiled function defines."""
    module = compiled.library._get_module_for_linking()
    parts = itertools.chain(module.functions, module.global_variables)
    return [part.name for part in parts if not part.is_declaration]


def loaded_library(
    symbols: list[str], codegen: Any, state: tuple[str, str, tuple[bytes, bytes]]
) -> Any:
    """Code of a function from a cache, as Numba's unserialize_library makes it of its state."""
    name, _, (machine_code, bitcode) = state
    library = codegen.create_library(name)
    library.enable_object_caching()
    library._set_compiled_object(machine_code)
    library._shared_module = _LaterModule(bitcode)
    library._finalize_final_module()
    codegen._engine._defined_symbols.update(symbols)
    return library


def in_kernels(
    function: Callable[..., Any], *patterns: tuple[Any, ...]
) -> Callable[[Any], Callable[..., Any]]:
    """Define what kernels run where they call a Python function.

    As numba.extending.intrinsic, whose functions have no Python body.

    Args:
        function: The function; its own body is what Python runs.
        patterns: Classes of the types of the arguments that it is defined for; none: of all.

    Returns:
        A decorator. What it takes gets the typing context and the types of the arguments; it
        returns the signature and what emits the code, or None for types that it does not take.
    """

    def register(define: Any) -> Callable[..., Any]:
        class Template(AbstractTemplate):  # type: ignore[misc]
            key = function

            def generic(self, args: Any, kws: Any) -> Any:
                fits = not kws and (not patterns or any(_fits(args, kinds) for kinds in patterns))
                defined = define(self.context, *args) if fits else None
                return defined[0] if defined else None

        Template.__name__ = Template.__qualname__ = function.__name__
        infer_global(function, types.Function(Template))

        def lower(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            _, generate = define(context.typing_context, *signature.args)
            return generate(context, builder, signature, values)

        for kinds in patterns or ((types.VarArg(types.Any),),):
            lower_builtin(function, *kinds)(lower)
        return function

    return register


def _fits(args: tuple[Any, ...], kinds: tuple[Any, ...]) -> bool:
    pairs = zip(args, kinds, strict=False)
    return len(args) == len(kinds) and all(k is types.Any or isinstance(a, k) for a, k in pairs)
