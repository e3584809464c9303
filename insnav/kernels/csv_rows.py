"""Numbers as text: rows of a table with fixed decimals, without trailing zeros."""

from __future__ import annotations

import numpy as np

from insnav.kernels import njit

WIDEST = 26  # bytes of a cell including its separator
LARGEST = 1e10  # from here on, and below `SMALLEST`, the shortest text has an exponent
SMALLEST = 1e-6
_EXACT = 1e15  # up to 15 digits: no two such decimals are the same double
_PAIRS = np.frombuffer(b"".join(b"%02d" % i for i in range(100)), np.uint8).copy()  # all numbers of two digits


@njit(cache=True)
def rows_as_text(values, scale, places, out):  # type: ignore[no-untyped-def]
    """Write numbers (k, n) as n rows, each column rounded to `places` (k,) decimals, into bytes `out`.

    `scale` (k,): ten to the power of `places`. A value that is not finite gives an empty cell. `out` has `WIDEST` bytes
    per number.
    Returns: number of bytes; -1 if a number needs an exponent or more digits.
    """
    at, one = np.uint64(0), np.uint64(1)  # unsigned indices need no check for counting from the end
    ten, hundred, myriad = np.uint64(10), np.uint32(100), np.uint64(10000)
    for row in range(values.shape[1]):
        for column in range(values.shape[0]):
            value = values[column, row]
            if np.isfinite(value):
                parts = np.rint(value * scale[column])
                size = abs(parts)
                if size >= min(_EXACT, LARGEST * scale[column]) or 0.0 < size < SMALLEST * scale[column]:
                    return -1
                if parts < 0.0:
                    out[at] = 45
                    at += one
                number, each = np.uint64(np.int64(size)), np.uint64(np.int64(scale[column]))  # signed: one instruction
                whole = np.uint64(np.int64(size / scale[column]))  # exact: both are integers below 2^53
                rest = number - whole * each
                count, limit = one, ten
                while whole >= limit:
                    count += one
                    limit *= ten
                at += count
                i = at
                while whole >= ten:
                    i -= one
                    tenth = whole // ten
                    out[i] = np.uint8(48) + np.uint8(whole - tenth * ten)
                    whole = tenth
                out[i - one] = np.uint8(48) + np.uint8(whole)
                if rest > 0:
                    out[at] = 46
                    odd = places[column] & one
                    if odd:
                        rest *= ten
                    i = at + places[column] - one + odd
                    while i > at + one + one:  # four digits at a time
                        left = rest // myriad
                        four = np.uint32(rest - left * myriad)
                        two = four // hundred
                        pair, low = np.uint64(2 * two), np.uint64(2 * (four - two * hundred))
                        out[i], out[i + one] = _PAIRS[low], _PAIRS[low + one]
                        out[i - one - one], out[i - one] = _PAIRS[pair], _PAIRS[pair + one]
                        rest = left
                        i -= np.uint64(4)
                    if i > at:
                        out[i], out[i + one] = _PAIRS[rest + rest], _PAIRS[rest + rest + one]
                    at += places[column]
                    while out[at] == 48:
                        at -= one
                    at += one
            out[at] = 44
            at += one
        out[at - one] = 10
    return np.int64(at)
