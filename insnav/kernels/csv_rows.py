"""Numbers as text: rows of a table in fixed decimals, without the zeros at their ends."""

from __future__ import annotations

import numpy as np

from insnav.kernels import njit

WIDEST = 26  # bytes of a cell with what follows it
LARGEST = 1e10  # from it on, and below `SMALLEST`, shortest texts have exponents
SMALLEST = 1e-6
_EXACT = 1e15  # a number of so many digits is the only one with its digits


@njit(cache=True)
def rows_as_text(values, scale, out):  # type: ignore[no-untyped-def]
    """Write numbers (k, n) as n rows, each column rounded to parts of one by its `scale` (k,), into bytes `out`.

    What is not finite is an empty cell. Returns: number of bytes; -1 if a number needs an exponent or more digits.
    """
    at = 0
    digits = np.zeros(20, np.uint8)
    for row in range(values.shape[1]):
        for column in range(values.shape[0]):
            value = values[column, row]
            if np.isfinite(value):
                parts = np.rint(value * scale[column])
                size = abs(parts)
                if size >= _EXACT or size >= LARGEST * scale[column] or 0.0 < size < SMALLEST * scale[column]:
                    return -1
                if parts < 0.0:
                    out[at] = 45
                    at += 1
                each = np.uint64(scale[column])
                number = np.uint64(size)
                whole = number // each
                rest = number - whole * each
                count = 0
                while whole > 0 or count == 0:
                    tenth = whole // np.uint64(10)
                    digits[count] = 48 + whole - tenth * np.uint64(10)
                    whole = tenth
                    count += 1
                for i in range(count):
                    out[at + i] = digits[count - 1 - i]
                at += count
                if rest > 0:
                    out[at] = 46
                    last = at
                    count = 0
                    while each > 1:
                        each //= np.uint64(10)
                        count += 1
                    for i in range(count, 0, -1):
                        tenth = rest // np.uint64(10)
                        digit = rest - tenth * np.uint64(10)
                        if digit > 0 and last == at:
                            last = at + i
                        out[at + i] = 48 + digit
                        rest = tenth
                    at = last + 1
            out[at] = 44
            at += 1
        out[at - 1] = 10
    return at
