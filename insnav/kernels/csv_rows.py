"""Numbers as text: rows of a table in fixed decimals, without the zeros at their ends."""

from __future__ import annotations

import numpy as np

from insnav.kernels import njit

WIDEST = 26  # bytes of a cell with what follows it
LARGEST = 1e10  # from it on, and below `SMALLEST`, shortest texts have exponents
SMALLEST = 1e-6
_EXACT = 1e15  # a number of so many digits is the only one with its digits
_PAIRS = np.frombuffer(b"".join(b"%02d" % i for i in range(100)), np.uint8).copy()  # all numbers of two digits


@njit(cache=True)
def rows_as_text(values, scale, out):  # type: ignore[no-untyped-def]
    """Write numbers (k, n) as n rows, each column rounded to parts of one by its `scale` (k,), into bytes `out`.

    What is not finite is an empty cell; `out` has room for `WIDEST` bytes a number.
    Returns: number of bytes; -1 if a number needs an exponent or more digits.
    """
    at = 0
    columns = values.shape[0]
    most, least, places = np.empty(columns), np.empty(columns), np.zeros(columns, np.int64)
    for column in range(columns):
        most[column], least[column] = min(_EXACT, LARGEST * scale[column]), SMALLEST * scale[column]
        while 10.0 ** places[column] < scale[column]:
            places[column] += 1
    ten, hundred = np.uint64(10), np.uint64(100)
    for row in range(values.shape[1]):
        for column in range(columns):
            value = values[column, row]
            if np.isfinite(value):
                parts = np.rint(value * scale[column])
                size = abs(parts)
                if size >= most[column] or 0.0 < size < least[column]:
                    return -1
                if parts < 0.0:
                    out[at] = 45
                    at += 1
                number, each = np.uint64(size), np.uint64(scale[column])
                whole = number // each
                rest = number - whole * each
                count, limit = 1, ten
                while whole >= limit:
                    count += 1
                    limit *= ten
                for i in range(at + count - 1, at - 1, -1):
                    tenth = whole // ten
                    out[i] = 48 + whole - tenth * ten
                    whole = tenth
                at += count
                if rest > 0:
                    out[at] = 46
                    if places[column] % 2:
                        rest *= ten
                    for i in range(at + places[column] - 1 + places[column] % 2, at, -2):  # two digits at a time
                        hundredth = rest // hundred
                        pair = 2 * (rest - hundredth * hundred)
                        out[i], out[i + 1] = _PAIRS[pair], _PAIRS[pair + 1]
                        rest = hundredth
                    at += places[column]
                    while out[at] == 48:
                        at -= 1
                    at += 1
            out[at] = 44
            at += 1
        out[at - 1] = 10
    return at
