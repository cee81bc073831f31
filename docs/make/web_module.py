"""Compile the simulator's kernels to WebAssembly, with their tables (pter_gym/tools/web/static).

Numba translates the kernels to unoptimised LLVM code, LLVM compiles that to a WebAssembly object,
and Zig (the package ``ziglang``) links it with the mathematical functions in ``functions.zig``. A
module whose object is that of the one before stays: a change of the tables alone, such as another
weight of the reward, needs no Zig.
"""

import os

if __name__ == "__main__":  # before numba is imported
    os.environ |= {"NUMBA_OPT": "0", "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}

import ast
import hashlib
import json
import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any, cast

import llvmlite.binding as llvm
import numba

from pter_gym._internal.files import write_bytes_atomic, write_text_atomic
from pter_gym.tools.web import kernels
from pter_gym.tools.web.kernels import KERNELS
from pter_gym.tools.web.site import MODULE, PAGES, TABLES
from pter_gym.tools.web.tables import tables

FUNCTIONS = Path(__file__).with_name("functions.zig")

PACKAGE = Path(__file__).parents[2] / "pter_gym"

ROOMS = ("_compiled", "_engine", "_physics", "controllers", "hands", "params", "paths", "tasks")
"""Folders of the package that the module is made of."""

SOURCES = [
    *sorted(PACKAGE.glob("*.py")),
    *(path for room in ROOMS for path in sorted((PACKAGE / room).rglob("*.py"))),
    *sorted((PACKAGE / "presets").glob("*.toml")),
]

TRIPLE = "wasm32-unknown-unknown"
DATA_LAYOUT = "e-m:e-p:32:32-p10:8:8-p20:8:8-i64:64-i128:128-n32:64-S128-ni:1:10:20"

OPTIONS = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

INSTRUCTIONS = {"sqrt": "llvm.sqrt.f64", "floor": "llvm.floor.f64"}
"""Functions that are exact instructions of WebAssembly."""

LINKED = ("sin", "cos", "exp", "log", "atan2")
"""Functions that are linked in, under names of our own."""

STACK = 1 << 16

COUNTING = re.compile(r"^.*call void @NRT_(incref|decref)\(.*$", re.MULTILINE)
"""Counts of references: the kernels' arrays are a page's memory and are not counted."""

KINDS: dict[Any, str] = {numba.types.int32: "i32", numba.types.float64: "double"}


def main(folder: Path) -> None:
    """Write the module and its tables to a folder."""
    code, tables_path, module_path = object_code(), folder / TABLES.name, folder / MODULE.name
    parts = hashlib.sha256(code + FUNCTIONS.read_bytes()).hexdigest()
    before = json.loads(tables_path.read_text("utf-8")) if tables_path.exists() else {}
    module = module_path.read_bytes() if before.get("parts") == parts else linked(code)
    text = as_text(module, parts)
    write_bytes_atomic(module_path, module)
    write_text_atomic(tables_path, text)
    print(f"{MODULE.name}: {len(module)} bytes, {TABLES.name}: {len(text.encode())} bytes")


def linked(code: bytes) -> bytes:
    """Return the module that Zig makes of the kernels' object file."""
    target = [
        "-target",
        "wasm32-freestanding",
        "-fno-entry",
        "--stack",
        str(STACK),
        "--export=__heap_base",
    ]
    exports = [f"--export={kernel.__name__}" for kernel in KERNELS]
    with tempfile.TemporaryDirectory() as folder:
        compiled, module = Path(folder) / "kernels.o", Path(folder) / "module.wasm"
        compiled.write_bytes(code)
        zig("build-exe", *target, str(compiled), *exports, f"-femit-bin={module}")
        return module.read_bytes()


def as_text(module: bytes, parts: str) -> str:
    """Return a module's tables as JSON, with hashes of the module, its parts and its sources."""
    content = tables()
    hashes = {
        "module": hashlib.sha256(module).hexdigest(),
        "parts": parts,
        "sources": digest(content),
    }
    return (
        json.dumps(
            {**hashes, **content}, ensure_ascii=False, separators=(",", ":"), allow_nan=False
        )
        + "\n"
    )


def digest(content: dict[str, Any]) -> str:
    """Return a hash of the tables and of what the kernels' source files mean, without comments."""
    total = hashlib.sha256(json.dumps(content).encode())
    for source in (*SOURCES, Path(kernels.__file__), Path(__file__)):
        total.update(meaning_of(source).encode())
    total.update(FUNCTIONS.read_bytes())
    return total.hexdigest()


def meaning_of(path: Path) -> str:
    """Return the content of a Python or TOML file as plain data in text, without docstrings.

    It depends neither on comments and layout nor on the version of Python.
    """
    text = path.read_text("utf-8")
    return repr(tomllib.loads(text) if path.suffix == ".toml" else _meaning(ast.parse(text)))


def _meaning(node: object) -> object:
    """Return a syntax tree without docstrings as plain data, the same in all Python versions."""
    if isinstance(node, list):
        return [_meaning(child) for child in cast("list[object]", node) if not _is_docstring(child)]
    if not isinstance(node, ast.AST):
        return repr(node)
    parts = (
        (name, _meaning(value)) for name, value in ast.iter_fields(node) if value not in (None, [])
    )
    return [type(node).__name__, *parts]


def _is_docstring(node: object) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def zig(command: str, *arguments: str) -> None:
    """Run Zig on the mathematical functions."""
    release = ("-O", "ReleaseFast", "-fstrip", "-mcpu", "baseline")
    subprocess.run(
        [sys.executable, "-m", "ziglang", command, str(FUNCTIONS), *release, *arguments], check=True
    )


def native_functions(path: Path) -> None:
    """Write the shared library of the mathematical functions for this computer."""
    zig("build-lib", "-dynamic", f"-femit-bin={path}")


def object_code() -> bytes:
    """Return the kernels as an object file for WebAssembly."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    modules = [llvm.parse_assembly(retargeted(*kernel)) for kernel in KERNELS.items()]
    whole = modules[0]
    for module in modules[1:]:
        whole.link_in(module)
    exported = {kernel.__name__ for kernel in KERNELS}
    for function in whole.functions:
        if not function.is_declaration and function.name not in exported:
            function.linkage = "internal"
    for variable in whole.global_variables:
        variable.linkage = "internal"
    machine = llvm.Target.from_triple(TRIPLE).create_target_machine(
        cpu="generic", features="+bulk-memory", opt=3, reloc="static"
    )
    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=3))
    builder.getModulePassManager().run(whole, builder)
    return machine.emit_object(whole)


def retargeted(kernel: Any, arguments: tuple[Any, ...]) -> str:
    """Return a kernel's LLVM code for WebAssembly, and a function of its name that calls it."""
    compiled: Any = numba.njit(numba.types.int32(*arguments), **OPTIONS)(kernel)
    (signature,) = compiled.signatures
    code: str = compiled.inspect_llvm(signature)
    name: str = compiled.overloads[signature].fndesc.llvm_func_name
    code = re.sub(r'target triple = ".*"', f'target triple = "{TRIPLE}"', code)
    code = re.sub(r'target datalayout = ".*"', f'target datalayout = "{DATA_LAYOUT}"', code)
    code = re.sub(r'"target-(cpu|features)"="[^"]*"', "", code)
    code = COUNTING.sub("", code)
    for function, instruction in INSTRUCTIONS.items():
        code = code.replace(f"@{function}(", f"@{instruction}(")
    for function in LINKED:
        code = re.sub(rf"@(llvm\.)?{function}(\.f64)?\(", f"@pter_{function}(", code)
    return code + entrance(kernel.__name__, arguments, name)


def entrance(exported: str, arguments: tuple[Any, ...], name: str) -> str:
    """Return the function by which a page calls a kernel, with plain arguments and value."""
    kinds = [KINDS.get(argument, "ptr") for argument in arguments]
    parameters = "".join(f", {kind} %{number}" for number, kind in enumerate(kinds))
    return f"""
define i32 @{exported}({parameters[2:]}) {{
  %value = alloca i32
  %error = alloca ptr
  %status = call i32 @{name}(ptr %value, ptr %error{parameters})
  %result = load i32, ptr %value
  ret i32 %result
}}
"""


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else PAGES)
