# pyright: standard
"""Philox4x64-10, a counter-based random number generator for kernels (Salmon et al., SC 2011).

A draw is a pure function of (seed, stream) and (draw, episode), so a world's draws depend on its
seed alone.
"""

import numpy as np

from pter_gym._compiled.compiler import inlined

_MULTIPLIER_0 = np.uint64(0xD2E7470EE14C6C93)
_MULTIPLIER_1 = np.uint64(0xCA5A826395121157)
_WEYL_0 = np.uint64(0x9E3779B97F4A7C15)
_WEYL_1 = np.uint64(0xBB67AE8584CAA73B)
_LOW = np.uint64(0xFFFFFFFF)
_32 = np.uint64(32)
_11 = np.uint64(11)
_ZERO = np.uint64(0)
_UNIT = 2.0**-53


@inlined
def _multiply(a: np.uint64, b: np.uint64) -> tuple[np.uint64, np.uint64]:
    """Return the high and the low word of a 128-bit product."""
    a_low = a & _LOW
    a_high = a >> _32
    b_low = b & _LOW
    b_high = b >> _32
    low = a_low * b_low
    middle = a_high * b_low + (low >> _32)
    carry = a_low * b_high + (middle & _LOW)
    return a_high * b_high + (middle >> _32) + (carry >> _32), (carry << _32) | (low & _LOW)


@inlined
def _add(a: np.uint64, b: np.uint64) -> np.uint64:
    """Return a sum modulo 2⁶⁴, by halves, since NumPy's scalars warn of overflows."""
    low = (a & _LOW) + (b & _LOW)
    return (((a >> _32) + (b >> _32) + (low >> _32)) << _32) | (low & _LOW)


@inlined
def philox(
    key_0: np.uint64, key_1: np.uint64, counter_0: np.uint64, counter_1: np.uint64
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Return four random 64-bit words for a key and the counter (counter_0, counter_1, 0, 0)."""
    x0 = counter_0
    x1 = counter_1
    x2 = _ZERO
    x3 = _ZERO
    for _ in range(10):
        high_0, low_0 = _multiply(_MULTIPLIER_0, x0)
        high_1, low_1 = _multiply(_MULTIPLIER_1, x2)
        x0 = high_1 ^ x1 ^ key_0
        x1 = low_1
        x2 = high_0 ^ x3 ^ key_1
        x3 = low_0
        key_0 = _add(key_0, _WEYL_0)
        key_1 = _add(key_1, _WEYL_1)
    return x0, x1, x2, x3


@inlined
def to_unit(word: np.uint64) -> float:
    """Return a number in [0, 1) from the upper 53 bits of a word."""
    return (word >> _11) * _UNIT


@inlined
def uniform4(
    seed: np.uint64, stream: np.uint64, draw: np.uint64, episode: np.uint64
) -> tuple[float, float, float, float]:
    """Return four uniform numbers in [0, 1): block ``draw`` of a world's stream in an episode."""
    w0, w1, w2, w3 = philox(seed, stream, draw, episode)
    return to_unit(w0), to_unit(w1), to_unit(w2), to_unit(w3)
