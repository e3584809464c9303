"""Compilation of the kernels before a run needs them, in up to four processes, at most one per core.

Numba holds a lock while it compiles, so threads would wait for each other. Each process stores its kernels in numba's
disk cache for all others. ``python -m insnav.kernels.ahead`` is such a process; a pipe names the kernels to compile.
"""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

from numba import __version__ as numba_version
from numba import types

from insnav.kernels import CONTENT, alignment, epoch, errorstate, increments, linear, measurements, output, smoother
from insnav.kernels import noise_likelihood as likelihood

_tuple: Any = types.BaseTuple.from_types
MOST = 4  # processes; more are useless, as the slowest kernel takes a quarter of the total time


def needed() -> bool:
    """Return whether this version of the kernels still has to be compiled on this machine, and can be stored."""
    return kept() and not _mark().exists()


def kept() -> bool:
    """Return whether compiled kernels can be stored for the next run."""
    return errorstate.propagate.stats.cache_path is not None


def _mark() -> Path:
    """Return the marker file next to numba's cache: it exists once these kernels are compiled."""
    return Path(errorstate.propagate.stats.cache_path) / f"ahead-{CONTENT[:16]}-{numba_version}"


def compile_ahead() -> None:
    """Compile all kernels, some of them in this process. A kernel that fails here is compiled when it is first called.

    A pipe holds the numbers of the groups of kernels; each idle process reads the next number.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    numbers, ours = os.pipe()
    os.write(ours, bytes(range(len(_kernels()))))
    os.close(ours)
    start = partial(subprocess.Popen, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    others = [start([sys.executable, "-m", __name__], stdin=numbers) for _ in range(1, min(MOST, cores))]
    try:
        _compile(numbers)
    except BaseException:
        for other in others:
            other.terminate()
        raise
    finally:
        os.close(numbers)
        for other in others:
            other.wait()
    _mark().touch()


def _compile(numbers: int) -> None:
    """Compile the kernels whose numbers can be read from a file descriptor."""
    gc.disable()  # compilation without garbage collection takes a sixth less time
    kernels = _kernels()
    while number := os.read(numbers, 1):
        for kernel, *given in kernels[number[0]]:
            kernel.compile(tuple(map(_type, given)))
    gc.enable()


def _type(given: Any) -> Any:
    """Return numba's type of an argument or of a tuple of arguments."""
    if not isinstance(given, tuple):
        return given
    return _tuple(tuple(map(_type, given)), type(given) if hasattr(given, "_fields") else None)


def _kernels() -> tuple[tuple[tuple[Any, ...], ...], ...]:
    """Return the kernels with their argument types, the slowest first; kernels that share code stand together."""
    d: Any = types.float64
    i, flag = types.int64, types.boolean
    d1, d2, d3, d4, i1 = d[::1], d[:, ::1], d[:, :, ::1], d[:, :, :, ::1], i[::1]
    i2: Any = i[:, ::1]
    propagation = (
        *(i, i, flag),
        *(d1, d1, d2, d2, d2, d2, d1),
        *5 * [d1],
        *(*4 * [d1], d2, d2, d2, d1, d1, i1, d1, d1, d2, i1, d2),
        (d2, d2, d2, d1, d2, d2, d1, d2),
    )
    assessment = (d1, d2, d1, *4 * [d2], i, flag, d, d, d, i2, d1, d2, d2, d2, d1)
    system, measured, kept = (d1, d3, d2, d3, d2, i1), (d2, d3, d2, d2), (d2, d2, d3, i1, d2, d3)
    run = (d1, i1, d3, d4, d2, d2, d2, d3, d2, d3, d2, d3)
    return (
        (
            (errorstate.propagate, *propagation),
            (alignment.window_histories, d1, d2, d2, i1, d3),
            (alignment.gyro_history, d1, d1, d1, d2, d2, d2, d2),
            *((smoother.correct, d1, d2, d1, d2, d2), (errorstate.feed_back, d1, d1, d1)),
            (epoch.take, *3 * [d1], i2, flag),
        ),
        (
            (smoother.backward, d2, i, d, d1, d2, d2, d2, d3, d2, d2),
            (measurements.innovation, d2, d1, d2, d1, i, i, d2),
            *((measurements.inverse, d2), (errorstate.less_sure, d2, d), (epoch.least_delay_sd, d1, d1)),
            (epoch.note_fix, d1, d, d1, d1, d, d, flag, flag, d1, d1, d2),
        ),
        (
            (increments.increments, flag, d1, d1, d2, d2, i1, d4, d4, i1, d1, d1, d2, d2, d2, d2),
            *((output.moved, d1, d1, d, d1), (output.add_moved, d2, i1, d2, d, d2)),
        ),
        ((likelihood.innovations, run, *3 * [d1], i, d1, d1, d2, (d1, d2), d3, d, d2),),
        (
            (measurements.assess, *assessment),
            (measurements.zero_velocity, d1, d1, d1, d1, d2),
            (measurements.vehicle_velocity, d1, d1, d2, d1, d, d1, d2),
        ),
        (
            (linear.forward, system, measured, (d1, d2), (i1, d3), kept),
            (linear.backward, system, measured, kept, i1, d2, d3, d2, d2, d3, d1),
            *((linear.cross, system, measured, kept, d3, i, d2, i), (linear.gains, d2, d3, d1, d2)),
        ),
        ((alignment.level_history, d1, d2, d2, d1, d, d1, d2),),
        ((output.rows_as_text, d2, d1, types.uint64[::1], types.uint8[::1]),),
        ((output.deviations, d1, i1, d2, d1, d2, d2), (output.sides, d2, d2, d2)),
        ((smoother.keep, d1, d, *3 * [d1], d2, d2), (epoch.predicted, d1, d, d1, d1, d2, d2, d2, d1, d1)),
        ((alignment.joined, d1, d1, d2, d2, d1, flag, i, i, d2),),
        ((alignment.mean_rotation, d3, d3, d1, d, d3, d2, d1),),
        ((increments.glance, d2, d2, d1, d1, d), (increments.interval_ends, d1, d, d, i, d, i, i, d1, d1)),
        ((errorstate.move_along, d2, d1), (errorstate.move_by_motion, d2, i1, d2, d1)),
        ((alignment.window_scatter, d1, d2, d2, flag, *4 * [i], d3, d2),),
        ((smoother.keep_measurement, d1, i, i, d1, d2, d2), (increments.split, d1, d1, i, i, d1, d, i1, d1, d1)),
        ((measurements.measurement_fault, d1, d2, d2), (measurements.fault_of, d2, d1)),
        ((epoch.fade, d1, i2, d1, d1, d2, d2, d1), (epoch.note_epoch, d1, d, *3 * [d1], d2)),
        ((epoch.felt, d1, *4 * [d2], i, d, flag, flag, d1), (epoch.turn, d2, d1), (epoch.not_linear, d2, d1, d2)),
        ((epoch.beyond_linear, d1, d, d), (epoch.count_tilt, d1, d, d)),
    )


if __name__ == "__main__":
    _compile(sys.stdin.fileno())
