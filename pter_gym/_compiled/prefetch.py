"""A hint to the processor that memory is needed soon: it fetches it while it goes on. Plain Python does without."""

from typing import Any

from llvmlite import ir
from numba.core import cgutils, config, types
from numba.extending import intrinsic

LINE = 8
"""Numbers of 8 bytes in a cache line."""

_FOR_READING, _INTO_SECOND_LEVEL, _DATA = 0, 2, 1

_NUMBA: Any = config
_cgutils: Any = cgutils


def _ignored(*_: Any) -> None:
    """Do nothing, as there is no compiler."""


def _compiled_alone(generator: Any) -> Any:
    """Return what puts instructions into compiled code."""
    return _ignored if _NUMBA.DISABLE_JIT else intrinsic(generator)


@_compiled_alone
def prefetch(typing: Any, array: Any, b: Any, row: Any, lane: Any) -> Any:  # noqa: ARG001
    """Begin to fetch the cache line of an array's element into the second-level cache."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = signature.args[0]
        values = context.make_array(kind)(context, builder, arguments[0])
        at = [
            context.cast(builder, value, given, types.intp)
            for value, given in zip(arguments[1:], signature.args[1:], strict=True)
        ]
        element = _cgutils.get_item_pointer(context, builder, kind, values, at)
        byte, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        hint = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        function = _cgutils.get_or_insert_function(builder.module, hint, "llvm.prefetch.p0")
        how = (number(_FOR_READING), number(_INTO_SECOND_LEVEL), number(_DATA))
        builder.call(function, [builder.bitcast(element, byte), *how])
        return context.get_dummy_value()

    return types.void(array, b, row, lane), generate
