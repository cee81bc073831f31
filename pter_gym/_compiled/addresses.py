# pyright: standard
"""Addresses in compiled code: of numbers, and of kernels, which are called as they are."""

from collections.abc import Iterable
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.extending import intrinsic
from numpy.typing import NDArray

_cgutils: Any = cgutils

_EXPORTED: list[Any] = []
"""Kernels whose symbols are known: their code must stay where it is."""


def pointer(kind: Any) -> Any:
    """Return a compiled function from an address to a pointer to numbers of a kind."""

    @intrinsic
    def to(typing: Any, address: Any) -> Any:  # noqa: ARG001
        numbers = types.CPointer(kind)

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ARG001
            return builder.inttoptr(arguments[0], context.get_value_type(numbers))

        return numbers(types.int64), generate

    return to


whole, double, single = pointer(types.int64), pointer(types.float64), pointer(types.float32)
unsigned, flag = pointer(types.uint64), pointer(types.boolean)


def address_of(kernel: Any, signature: Any) -> int:
    """Compile a kernel for a signature, and return where its machine code is while it exists."""
    kernel.compile(signature)
    compiled = kernel.overloads[tuple(signature.args)]
    return compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)


def export(kernel: Any, signature: Any, symbol: str) -> None:
    """Compile a kernel for a signature, and let a symbol stand for its machine code."""
    llvm.add_symbol(symbol, address_of(kernel, signature))
    _EXPORTED.append(kernel)


def table_of(arrays: Iterable[NDArray[Any]]) -> NDArray[np.int64]:
    """Return the address of each array and its shape, of up to three axes: whole numbers (N, 4)."""
    rows = [(array.ctypes.data, *array.shape, 0, 0)[:4] for array in arrays]
    return np.array(rows, np.int64)


def caller(signature: Any, symbol: str) -> Any:
    """Return a compiled function of a tuple of arguments, which calls what a symbol stands for."""

    @intrinsic
    def call(_: Any, arguments: Any) -> Any:
        _check_arguments(arguments, signature)

        def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
            kind = _kind_of(context, signature)
            function = _cgutils.get_or_insert_function(builder.module, kind, symbol)
            return _call(context, builder, signature, function, values[0])

        return signature.return_type(arguments), generate

    return call


def caller_at(signature: Any) -> Any:
    """Return what ``caller`` does for an address, which comes before the tuple of arguments."""

    @intrinsic
    def call(_: Any, address: Any, arguments: Any) -> Any:
        _check_arguments(arguments, signature)

        def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
            kind = _kind_of(context, signature)
            function = builder.inttoptr(values[0], kind.as_pointer())
            return _call(context, builder, signature, function, values[1])

        return signature.return_type(address, arguments), generate

    return call


def _check_arguments(arguments: Any, signature: Any) -> None:
    if arguments != types.Tuple(signature.args):
        raise TypingError(f"takes {signature.args}, got {arguments}")


def _kind_of(context: Any, signature: Any) -> Any:
    return context.call_conv.get_function_type(signature.return_type, signature.args)


def _call(context: Any, builder: Any, signature: Any, function: Any, arguments: Any) -> Any:
    """Write a call with a tuple of arguments, which passes on what is raised there."""
    convention, parts = context.call_conv, _cgutils.unpack_tuple(builder, arguments)
    status, value = convention.call_function(
        builder, function, signature.return_type, signature.args, parts
    )
    with _cgutils.if_unlikely(builder, status.is_error):
        convention.return_status_propagate(builder, status)
    return value
