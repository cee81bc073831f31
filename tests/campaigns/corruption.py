"""Damage to files of any format: to their bytes, to what they write as text, and to what is packed in them."""

import gzip
import re
import zlib
from collections.abc import Callable, Sequence
from functools import cache
from random import Random

Change = Callable[[bytes], bytes]
"""From the content of a file, or of what is packed in one, to other content."""

Inside = Callable[[bytes, Random, Change], bytes]
"""Changes what is packed in a file, and packs it again as it should be."""

WORD = 4

HUGE_FILE, BOMB = 1 << 25, 1 << 29
"""Bytes of a file that is too large, and of what a bomb holds."""

DENSE = 3 << 20
"""Bytes of a text that is full of small values, not too large to be parsed."""

NUMBER = re.compile(rb"-?\d+(\.\d+)?([eE][+-]?\d+)?")
TEXT = re.compile(rb'"[^"\n]*"')
PART = re.compile(rb"(?:^|(?<=[,\n]))[^,\n]+[,\n]")
"""What a comma or the end of a line ends: a name and its value, a row, an entry. One pass finds it, also in a large
file that has neither."""

NUMBERS = (
    *(b"NaN", b"Infinity", b"-Infinity", b"nan", b"inf", b"-inf", b"1e999", b"-1e999"),
    *(b"0", b"-0.0", b"-1", b"1e308", b"1e-320", b"0.5", b"1_0", b"0x10", b"2147483648", b"18446744073709551616"),
    *(b"9" * 30, b"9" * 400, b"9" * 5000, b"1" + b"0" * 300 + b".5", b"true", b"null", b'"3"', b"[]", b"{}", b"[[1]]"),
    *("\uff11".encode(), b"1979-05-27", b"1,5"),
)
"""What a number may become."""

TEXTS = (
    *(b'""', b'"\\ud800"', b'"\\udc00\\ud800"', b'"\\u0000"', b'"\xed\xa0\x80"', b'"\xff"', b'"../../etc/passwd"'),
    *(b'"__class__"', b'"' + b"x" * 100_000 + b'"', b'"\\u001b[2J"', b"3", b"null", b"[]", b'{"type": "Machine"}'),
    b'"."',
    *(b'"a"."b"', b"'", b'"""', b'"O"', b"'|O'", b"'<f8'", b"'|V0'"),
)
"""What a text may become."""


def corrupted(data: bytes, rng: Random, insides: Sequence[Inside]) -> bytes:
    """Return data with one to three damages, each outside or in what is packed there."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        change = rng.choice(CHANGES)
        within = bool(insides) and rng.random() < 0.6
        data = _inside(data, rng, rng.choice(insides), change) if within else change(data, rng)
    return data


def _inside(data: bytes, rng: Random, inside: Inside, change: Callable[[bytes, Random], bytes]) -> bytes:
    """Return data with damage inside, or outside where an earlier damage has left nothing to unpack."""
    try:
        return inside(data, rng, lambda content: change(content, rng))
    except Exception:  # noqa: BLE001  (what cannot be unpacked any more)
        return change(data, rng)


# bytes


def cut(data: bytes, rng: Random) -> bytes:
    """Leave the rest out."""
    return data[: rng.randrange(len(data) + 1)]


def flip(data: bytes, rng: Random) -> bytes:
    """Flip some bits."""
    found = bytearray(data or b"\0")
    for _ in range(rng.choice((1, 1, 2, 8, 64))):
        found[rng.randrange(len(found))] ^= 1 << rng.randrange(8)
    return bytes(found)


def overwrite(data: bytes, rng: Random) -> bytes:
    """Write a word that is small, huge or anything, as a size would be."""
    at = rng.randrange(len(data) + 1)
    word = rng.choice((bytes(8), b"\xff" * WORD, b"\xff" * 7 + b"\x7f", b"\0\0\0\x80", rng.randbytes(WORD)))
    return data[:at] + word + data[at + len(word) :]


def swap_words(data: bytes, rng: Random) -> bytes:
    """Swap two words, such as sizes."""
    if len(data) < 2 * WORD:
        return data[::-1]
    one, two = sorted(rng.sample(range(len(data) - WORD + 1), 2))
    two = max(two, one + WORD)
    return data[:one] + data[two : two + WORD] + data[one + WORD : two] + data[one : one + WORD] + data[two + WORD :]


def leave_out(data: bytes, rng: Random) -> bytes:
    """Leave some out."""
    at = rng.randrange(len(data) + 1)
    return data[:at] + data[at + rng.choice((1, 1, 2, 16, 300)) :]


def repeat(data: bytes, rng: Random) -> bytes:
    """Write a piece twice or more."""
    at = rng.randrange(len(data) + 1)
    return data[:at] + data[at : at + rng.choice((1, 2, 16, 300))] * rng.choice((2, 2, 3, 50)) + data[at:]


def insert(data: bytes, rng: Random) -> bytes:
    """Write any bytes between."""
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.randbytes(rng.choice((1, 2, 8, 100))) + data[at:]


def other(data: bytes, rng: Random) -> bytes:
    """Write something else altogether."""
    texts = (b"", b"[]", b"{}", b"3", b"null", b"\xff\xfe", b"\0" * len(data))
    return rng.choice((*texts, b"\xef\xbb\xbf" + data, data[::-1], data + data))


def enlarge(data: bytes, rng: Random) -> bytes:
    """Make a file too large, or one that is full; seldom, as it takes long."""
    if rng.random() < 0.9:
        return data + bytes(rng.choice((1, 100)))
    copies = min(2000, HUGE_FILE // max(1, len(data)))
    piece = rng.choice((b"[],", b'{"":0},', b"1,", b"a=1\n", b"[[a]]\n", b"{},", b"0,0,0\n", b"a.a.a.a.a=1\n"))
    return rng.choice(
        (b" " * HUGE_FILE, b"[" + piece * (DENSE // len(piece)) + b"0]", piece * (DENSE // len(piece)), data * copies)
    )


# text


def other_number(data: bytes, rng: Random) -> bytes:
    """Write another number, or what is none."""
    return _replaced(data, rng, NUMBER, rng.choice(NUMBERS))


def other_text(data: bytes, rng: Random) -> bytes:
    """Write another text, one from elsewhere in the file, or what is none."""
    there = [match[0] for match in TEXT.finditer(data)]
    return _replaced(data, rng, TEXT, rng.choice(there if there and rng.random() < 0.5 else TEXTS))


def nested(data: bytes, rng: Random) -> bytes:
    """Nest a value, a little or deeply."""
    levels = rng.choice((1, 2, 9, 20, 150, 2000, 100_000))
    open_, close = rng.choice(((b"[", b"]"), (b'{"a":', b"}"), (b"{a=", b"}"), (b"(", b")")))
    return _replaced(data, rng, rng.choice((NUMBER, TEXT)), open_ * levels + b"1" + close * rng.choice((0, levels)))


def entries(data: bytes, rng: Random) -> bytes:
    """Write an entry, a row, or a name with its value twice, not at all, or below a long name."""
    long = b".".join([b"a"] * rng.choice((3, 50, 3000)))
    change = rng.choice((lambda found: found + found, lambda _: b"", lambda found: long + found))
    return _rewritten(data, rng, PART, change)


def _replaced(data: bytes, rng: Random, kind: "re.Pattern[bytes]", by: bytes) -> bytes:
    return _rewritten(data, rng, kind, lambda _: by)


def _rewritten(data: bytes, rng: Random, kind: "re.Pattern[bytes]", change: Change) -> bytes:
    """Return data with one match of a kind rewritten, the next one behind any place."""
    match = kind.search(data, rng.randrange(len(data) + 1)) or kind.search(data)
    return data if match is None else data[: match.start()] + change(match[0]) + data[match.end() :]


CHANGES: tuple[Callable[[bytes, Random], bytes], ...] = (
    *(cut, flip, overwrite, swap_words, leave_out, repeat, insert, other, enlarge),
    *(other_number, other_number, other_text, other_text, nested, entries, entries, entries),
)


# packed


@cache
def bomb(wbits: int) -> bytes:
    """Return half a gigabyte of zeros, packed."""
    packer = zlib.compressobj(9, zlib.DEFLATED, wbits)
    return b"".join(packer.compress(bytes(1 << 20)) for _ in range(BOMB >> 20)) + packer.flush()


def in_gzip(data: bytes, rng: Random, change: Change) -> bytes:
    """Change what is in a file of gzip, or put a bomb in its place."""
    if rng.random() < 0.02:
        return bomb(31)
    return gzip.compress(change(gzip.decompress(data)), 1)


def in_header(data: bytes, rng: Random, change: Change) -> bytes:
    """Change the header of a file of weights, of which the first eight bytes say the length."""
    size = int.from_bytes(data[:8], "little")
    header = change(data[8 : 8 + size])
    if rng.random() < 0.8:
        header += b" " * (-len(header) % 8)
    return len(header).to_bytes(8, "little") + header + data[8 + size :]
