"""All compiled code: functions over plain arrays in SI and radians; no input or output, no logging."""

from insnav.deferred import deferred

with deferred("scipy.linalg", "scipy.linalg.cython_blas", "yaml"):  # numba only looks whether they are there: 0.12 s
    import numba.np.arraymath  # noqa: F401
