"""Each instruction in C gives what an engine for WebAssembly does."""

import ctypes
import itertools
import json
import math
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

import pytest

from pter_gym.errors import DataError
from pter_gym.tools.deploy.wasm_to_c import KINDS, NARROWING, OPERATORS, translated

NUMBERS = {kind: number for number, kind in KINDS.items()}
FORMS = {"i32": "<I", "i64": "<Q", "f32": "<f", "f64": "<d"}
TYPES = {
    "i32": ctypes.c_uint32,
    "i64": ctypes.c_uint64,
    "f32": ctypes.c_float,
    "f64": ctypes.c_double,
}
REALS = (0.0, -0.0, 1.0, -1.5, 2.5, -2.5, 0.49999997, 3e9, -3e9, 1e19, -1e19, 1e-40)
REALS += (math.inf, -math.inf, math.nan)
VALUES: dict[str, tuple[Any, ...]] = {
    "i32": (0, 1, 7, 33, 0x80, 0x8000, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF),
    "i64": (0, 1, 7, 65, 0x80, 0x8000, 0x80000000, 2**53 + 1, 2**63 - 1, 2**63, 2**64 - 1),
    "f32": struct.unpack("<15f", struct.pack("<15f", *REALS)),
    "f64": REALS,
}
DIVISIONS = (*range(0x6D, 0x71), *range(0x7F, 0x83))

SOURCES = dict(
    itertools.chain.from_iterable(
        ((code, kind) for code in codes)
        for kind, codes in {
            "i32": (
                *range(0x45, 0x50),
                *range(0x67, 0x79),
                0xAC,
                0xAD,
                0xB2,
                0xB3,
                0xB7,
                0xB8,
                0xBE,
            ),
            "i64": (*range(0x50, 0x5B), *range(0x79, 0x8B), 0xA7, 0xB4, 0xB5, 0xB9, 0xBA, 0xBF),
            "f32": (
                *range(0x5B, 0x61),
                *range(0x8B, 0x99),
                0xBB,
                0xBC,
                *(NARROWING + k for k in (0, 1, 4, 5)),
            ),
            "f64": (
                *range(0x61, 0x67),
                *range(0x99, 0xA7),
                0xB6,
                0xBD,
                *(NARROWING + k for k in (2, 3, 6, 7)),
            ),
        }.items()
    )
) | {code: "i32" if code < 0xC2 else "i64" for code in range(0xC0, 0xC5)}
"""Types of the operands."""


def sized(data: bytes) -> bytes:
    """Data behind its length."""
    return whole(len(data)) + data


def whole(number: int) -> bytes:
    """A whole number as modules have it."""
    low, rest = number & 0x7F, number >> 7
    return bytes([low | 0x80]) + whole(rest) if rest else bytes([low])


def listed(entries: list[bytes]) -> bytes:
    return sized(whole(len(entries)) + b"".join(entries))


def code_of(number: int) -> bytes:
    return bytes([0xFC, number - NARROWING]) if number >= NARROWING else bytes([number])


def operands(number: int) -> int:
    return 2 if "{1}" in OPERATORS[number].text else 1


def module() -> bytes:
    """A module with a function for each instruction."""
    types, bodies, exports = [], [], []
    for at, number in enumerate(OPERATORS):
        given = bytes([NUMBERS[SOURCES[number]]]) * operands(number)
        types.append(b"\x60" + sized(given) + sized(bytes([NUMBERS[OPERATORS[number].result]])))
        gets = b"".join(bytes([0x20, k]) for k in range(operands(number)))
        bodies.append(sized(b"\0" + gets + code_of(number) + b"\x0b"))
        exports.append(sized(f"o{number}".encode()) + b"\0" + whole(at))
    exports.append(sized(b"__heap_base") + b"\3\0")
    functions = [whole(k) for k in range(len(types))]
    parts = {1: types, 3: functions, 6: [b"\x7f\0\x41\0\x0b"], 7: exports, 10: bodies}
    return b"\0asm\1\0\0\0" + b"".join(bytes([k]) + listed(each) for k, each in parts.items())


def cases() -> list[tuple[int, tuple[Any, ...]]]:
    found: list[tuple[int, tuple[Any, ...]]] = []
    for number in OPERATORS:
        kind = SOURCES[number]
        for given in itertools.product(VALUES[kind], repeat=operands(number)):
            least = 1 << (31 if kind == "i32" else 63)
            undefined = number in DIVISIONS and (
                given[1] == 0 or (given[0] == least and given[1] == 2 * least - 1)
            )
            if not undefined:
                found.append((number, given))
    return found


def bits(kind: str, value: Any) -> str:
    return "nan" if value != value else struct.pack(FORMS[kind], value).hex()


NODE = """
const { module, cases } = JSON.parse(require("fs").readFileSync(0));
const compiled = new WebAssembly.Module(Buffer.from(module, "hex"));
const kernels = new WebAssembly.Instance(compiled).exports;
const view = new DataView(new ArrayBuffer(8));
const read = {
  i32: () => view.getInt32(0, true), i64: () => view.getBigInt64(0, true),
  f32: () => view.getFloat32(0, true), f64: () => view.getFloat64(0, true) };
const write = {
  i32: (x) => view.setInt32(0, x, true), i64: (x) => view.setBigInt64(0, x, true),
  f32: (x) => view.setFloat32(0, x, true), f64: (x) => view.setFloat64(0, x, true) };
const size = { i32: 4, i64: 8, f32: 4, f64: 8 };
const number = (kind, text) => {
  if (text === "nan") return NaN;
  Buffer.from(text, "hex").forEach((byte, k) => view.setUint8(k, byte));
  return read[kind]();
};
const answers = cases.map(([name, of, to, given]) => {
  const value = kernels[name](...given.map((text) => number(of, text)));
  if (value !== value) return "nan";
  write[to](value);
  return Buffer.from(view.buffer, 0, size[to]).toString("hex");
});
console.log(JSON.stringify(answers));
"""


@pytest.mark.skipif(
    shutil.which("node") is None or shutil.which("cc") is None, reason="needs node and cc"
)
def test_every_instruction_is_that_of_an_engine(tmp_path: Path) -> None:
    for name, text in translated(module(), "o").items():
        (tmp_path / name).write_text(text)
    options = ["-std=c99", "-O1", "-ffp-contract=off", "-shared", "-fPIC"]
    library = tmp_path / "module.so"
    command = ["cc", *options, "module.c", "-o", str(library), "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    compiled = ctypes.CDLL(str(library))
    found, told = [], []
    for number, given in cases():
        of, to = SOURCES[number], OPERATORS[number].result
        function = getattr(compiled, f"o_o{number}")
        function.argtypes = [ctypes.c_void_p, *[TYPES[of]] * len(given)]
        function.restype = TYPES[to]
        found.append(bits(to, function(None, *given)))
        told.append((f"o{number}", of, to, [bits(of, each) for each in given]))
    text = json.dumps({"module": module().hex(), "cases": told})
    run = subprocess.run(
        ["node", "--single-threaded", "-e", NODE],
        input=text,
        capture_output=True,
        text=True,
        check=True,
    )
    wrong = [
        (hex(number), given, ours, theirs)
        for (number, given), ours, theirs in zip(
            cases(), found, json.loads(run.stdout), strict=True
        )
        if ours != theirs
    ]
    assert not wrong


@pytest.mark.parametrize(
    "data",
    [
        b"not a module",
        b"\0asm\1\0\0\0\x08\x01\x00",
        b"\0asm\1\0\0\0\x01"
        + listed([b"\x60\0\0"])
        + b"\x03"
        + listed([b"\0"])
        + b"\x06"
        + listed([b"\x7f\0\x41\0\x0b"])
        + b"\x07"
        + listed([sized(b"__heap_base") + b"\3\0"])
        + b"\x0a"
        + listed([sized(b"\0\xfd\0\x0b")]),
    ],
    ids=["text", "start", "vectors"],
)
def test_what_is_not_translated_is_refused(data: bytes) -> None:
    with pytest.raises(DataError):
        translated(data, "o")
