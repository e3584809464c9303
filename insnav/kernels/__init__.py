"""All compiled code: functions over plain arrays in SI and radians; no input or output, no logging."""

from __future__ import annotations

import os
from functools import partial

from insnav.deferred import deferred

# numba reads it once: colours for errors, of which it makes many that it gets over, take 3 % of the compiling
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
with deferred("scipy.linalg", "scipy.linalg.cython_blas", "yaml"):  # numba only looks whether they are there: 0.12 s
    import numba.np.arraymath

# division by zero gives inf or NaN, as in numpy, and C calls no kernel: a tenth less to compile
njit = partial(numba.njit, error_model="numpy", no_cfunc_wrapper=True)
inner = partial(njit, no_cpython_wrapper=True)  # called by kernels alone: kept within these, no entry from Python
