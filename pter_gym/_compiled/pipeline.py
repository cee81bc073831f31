"""How numba compiles kernels and their parts: in half of its usual time.

Numba optimises each function and makes machine code of it, even where the function is copied into
every kernel that calls it. Here only kernels get that far. Numba also rebuilds a constant record
wherever an entry of it is read; here only the entry is read. Without this file, compiling the
kernels takes 2.7 times as long, and they run at 40 % of their speed.

What it takes from numba may change with any version of numba: ``register_pass`` and
``FunctionPass``, the pass ``TranslateByteCode`` and ``DefaultPassBuilder``, which it extends; of a
function under compilation ``func_ir.blocks``, ``_definitions`` and the nodes ``Assign``, ``Const``,
``Expr``, ``FreeVar`` and ``Global``; of code libraries ``_ensure_finalized``, ``_finalized``,
``_finalize_dynamic_globals``, ``_optimize_final_module``, ``_finalize_final_module`` and
``set_env``; of a kernel ``_compiler.compile`` and ``stats.cache_path``. ``compiler.py`` takes
``Dispatcher.add_overload`` and ``_cache`` too, ``stored.py`` of ``FunctionCache`` ``_cache_path``,
``_index_key``, ``_impl`` (``check_cachable``, ``reduce``, ``rebuild``, ``locator``) and, of its
``_cache_file``, ``_dump`` and ``_open_for_write``.
"""

import functools
import logging
import multiprocessing
from collections import Counter
from collections.abc import Iterator
from threading import Timer
from typing import Any, cast

from numba.core import compiler_machinery, ir, ir_utils
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.untyped_passes import TranslateByteCode

PATIENCE = 1.0
"""Seconds of compiling after which the user gets a message."""

CACHED = "compiling, once: about 20 s"
NOT_CACHED = "compiling for this process alone, as it cannot be stored: about 20 s"
NOT_STORED = "compiled code cannot be stored: other processes will compile again"

_machinery: Any = compiler_machinery

_log = logging.getLogger(__name__.partition(".")[0])


def announce(kernel: Any) -> None:
    """Let a kernel log a message when it has been compiling for longer than ``PATIENCE``."""
    compiler = kernel._compiler
    compile_now = compiler.compile

    def compile_announced(*signature: Any) -> Any:
        timer = Timer(PATIENCE, warn, (CACHED if kernel.stats.cache_path else NOT_CACHED,))
        timer.daemon = True
        timer.start()
        try:
            return compile_now(*signature)
        finally:
            timer.cancel()

    compiler.compile = compile_announced


@functools.cache
def warn(text: str) -> None:
    """Log a warning once, and in no worker process."""
    if multiprocessing.parent_process() is None:
        _log.warning("%s: %s", _log.name, text)


@_machinery.register_pass(mutates_CFG=False, analysis_only=False)
class _FoldRecords(_machinery.FunctionPass):
    """Replace ``ROW.motion.theta_a`` by its value, where ``ROW`` is a constant record."""

    _name = "fold_records"

    def __init__(self) -> None:  # abstract in numba
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Change the function; return whether anything has changed."""
        blocks = state.func_ir.blocks
        records = _fold(blocks)
        if records:
            _drop_unused(blocks, records)
            state.func_ir._definitions = ir_utils.build_definitions(blocks)
        return bool(records)


def _assignments(blocks: Any) -> Iterator[Any]:
    for block in blocks.values():
        yield from (each for each in block.body if isinstance(each, ir.Assign))


def _fold(blocks: Any) -> set[str]:
    """Read the entries of constant records; return the names that hold records."""
    times = Counter(each.target.name for each in _assignments(blocks))
    records: dict[str, Any] = {}
    for each in _assignments(blocks):
        value: Any = each.value
        if isinstance(value, ir.Global | ir.FreeVar):
            found = cast(Any, value).value
        elif (
            isinstance(value, ir.Expr)
            and value.op == "getattr"
            and cast(Any, value).value.name in records
        ):
            expression = cast(Any, value)
            record = records[expression.value.name]
            if expression.attr not in record._fields:
                continue
            found = getattr(record, expression.attr)
            if type(found) in (int, float):
                each.value = ir.Const(found, each.loc)
            elif _is_record(found):
                each.value = ir.Global(expression.attr, found, each.loc)
        else:
            continue
        if _is_record(found) and times[each.target.name] == 1:
            records[each.target.name] = found
    return set(records)


def _is_record(value: Any) -> bool:
    return isinstance(value, tuple) and hasattr(cast(Any, value), "_fields")


def _drop_unused(blocks: Any, records: set[str]) -> None:
    """Remove the assignments of records that nothing reads any more."""
    statements = [each for block in blocks.values() for each in block.body]
    named = Counter(variable.name for each in statements for variable in each.list_vars())
    set_here = Counter(each.target.name for each in _assignments(blocks))
    unused = {name for name in records if named[name] == set_here[name]}
    for block in blocks.values():
        block.body = [
            each
            for each in block.body
            if not (isinstance(each, ir.Assign) and each.target.name in unused)
        ]


class Kernel(CompilerBase):
    """Numba's steps for a kernel."""

    def define_pipelines(self) -> list[Any]:
        """Return numba's usual steps and the one for records."""
        steps: Any = DefaultPassBuilder.define_nopython_pipeline(self.state)
        steps.add_pass_after(_FoldRecords, TranslateByteCode)
        steps.finalize()
        return [steps]


class Part(Kernel):
    """Numba's steps for a function that only kernels call: they end before machine code."""

    def __init__(self, typing: Any, target: Any, library: Any, *args: Any) -> None:
        """Begin to compile a function."""
        super().__init__(typing, target, library or _PartLibrary(target.codegen(), "part"), *args)


class _PartLibrary(JITCodeLibrary):
    """Code that is copied into kernels and optimised there; none of it runs by itself."""

    @property
    def codegen(self) -> Any:
        """Where numba sets what running code needs: here, where nothing runs."""
        return self

    def set_env(self, *_: Any) -> None:
        """Set nothing."""

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002
        """Return that there is no machine code."""
        self._ensure_finalized()
        return 0

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True
