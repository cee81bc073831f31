# pyright: standard
"""How numba compiles kernels and their functions in little more than half of its usual time.

Numba optimises each function and makes machine code of it, even where the function is copied into
every kernel that calls it. Here only kernels get that far. Numba also rebuilds a constant record
wherever an entry of it is read; here only the entry is read. Without this file, compiling the
step's kernel takes 1.7 times as long, and a step of 1,024 worlds 1.4 times.

What it takes from numba may change with any version of numba: ``register_pass`` and
``FunctionPass``, the pass ``TranslateByteCode`` and ``DefaultPassBuilder``, which it extends; of a
function under compilation ``func_ir.blocks``, ``_definitions`` and the nodes ``Assign``, ``Const``,
``Expr``, ``FreeVar`` and ``Global``; of code libraries ``_ensure_finalized``, ``_finalized``,
``_finalize_dynamic_globals``, ``_optimize_final_module``, ``_finalize_final_module`` and
``set_env``. So ``pipeline.py`` tries it with a numba that it does not know.
"""

from collections import Counter
from collections.abc import Iterator
from typing import Any, cast

from numba.core import compiler_machinery, ir, ir_utils
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.untyped_passes import TranslateByteCode

_machinery: Any = compiler_machinery


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
    times = Counter(assignment.target.name for assignment in _assignments(blocks))
    records: dict[str, Any] = {}
    for assignment in _assignments(blocks):
        value: Any = assignment.value
        if isinstance(value, ir.Global | ir.FreeVar):
            constant = cast(Any, value).value
        elif (
            isinstance(value, ir.Expr)
            and value.op == "getattr"
            and cast(Any, value).value.name in records
        ):
            expression = cast(Any, value)
            record = records[expression.value.name]
            if expression.attr not in record._fields:
                continue
            constant = getattr(record, expression.attr)
            if type(constant) in (int, float):
                assignment.value = ir.Const(constant, assignment.loc)
            elif _is_record(constant):
                assignment.value = ir.Global(expression.attr, constant, assignment.loc)
        else:
            continue
        if _is_record(constant) and times[assignment.target.name] == 1:
            records[assignment.target.name] = constant
    return set(records)


def _is_record(value: Any) -> bool:
    return isinstance(value, tuple) and hasattr(cast(Any, value), "_fields")


def _drop_unused(blocks: Any, records: set[str]) -> None:
    """Remove the assignments of records that nothing reads any more."""
    statements = [each for block in blocks.values() for each in block.body]
    uses = Counter(variable.name for each in statements for variable in each.list_vars())
    set_here = Counter(each.target.name for each in _assignments(blocks))
    unused = {name for name in records if uses[name] == set_here[name]}
    for block in blocks.values():
        block.body = [
            each
            for each in block.body
            if not (isinstance(each, ir.Assign) and each.target.name in unused)
        ]


class KernelCompiler(CompilerBase):
    """Numba's steps for a kernel."""

    def define_pipelines(self) -> list[Any]:
        """Return numba's usual steps and the one for records."""
        steps: Any = DefaultPassBuilder.define_nopython_pipeline(self.state)
        steps.add_pass_after(_FoldRecords, TranslateByteCode)
        steps.finalize()
        return [steps]


class FunctionCompiler(KernelCompiler):
    """Numba's steps for a function that only kernels call: they end before machine code."""

    def __init__(self, typing: Any, target: Any, library: Any, *args: Any) -> None:
        """Begin to compile a function."""
        own = library or _FunctionLibrary(target.codegen(), "function")
        super().__init__(typing, target, own, *args)


class _FunctionLibrary(JITCodeLibrary):
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
