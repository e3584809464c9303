"""Other programs on the same drives: pyins, a filter, and GTSAM, a batch smoother, where they are installed."""

from __future__ import annotations

import importlib.util
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from insnav.engine import Workers, every
from insnav.exceptions import AlignmentError, InsnavError
from insnav.filter.navigate import navigate_recording
from insnav.filter.prepare import Prepared, prepare
from insnav.regression.cases import Material, source_of
from insnav.regression.corpus import Corpus, RecordedCase
from insnav.regression.evaluate import errors_of, settled
from insnav.regression.peers.programs import PeerRun, Task, run_gtsam, run_pyins
from insnav.regression.run_corpus import SERIES, AnyCase
from insnav.sample_statistics import rms
from insnav.simulate.montecarlo import run_seed
from insnav.types import Trajectory
from insnav.units import DEG

LONGEST = 150.0  # of a drive: pyins needs a quarter of a minute for it [s]
LATEST = 80.0  # errors count from here on at the latest [s]
_SPARSE = 0.5  # a solution with longer steps is evaluated at its own epochs, not between them [s]
_SAME = 5e-3  # as far from an epoch at most [s]


@dataclass(frozen=True, slots=True)
class PeerRow:
    """One program on one case."""

    case: str
    program: str
    rms: tuple[float | None, ...]  # North, East, Down [m]
    attitude_deg: tuple[float | None, ...]  # roll and pitch together, heading [deg]
    cpu_us: float | None  # CPU time a sample [us]
    remark: str = ""  # why there are no figures


def installed() -> dict[str, Callable[[Task], PeerRun]]:
    """Peers that are installed, by name."""
    known = {"pyins": ("pyins", run_pyins), "gtsam, smoothed": ("gtsam", run_gtsam)}
    return {name: run for name, (module, run) in known.items() if importlib.util.find_spec(module) is not None}


def run_peers(
    corpus: Corpus, data: Path, *, workers: Workers = 1, progress: Callable[[float], None] | None = None
) -> list[PeerRow]:
    """Give the first drive of every case, its first part, to insnav and to every peer.

    `data`: folder of recorded data; cases without theirs are left out.
    """
    cases = [case for case in corpus.cases if not isinstance(case, RecordedCase) or (data / case.data).is_dir()]
    found = every(_compared, [(case, data) for case in cases], workers, progress=progress)
    return [row for rows in found for row in rows]


def _compared(of: tuple[AnyCase, Path]) -> list[PeerRow]:
    """Every program on one case, with the folder of recorded data."""
    case, data = of
    whole = source_of(case, data).material(run_seed(SERIES, 1))
    rows = []
    try:
        material, ready = _begun(whole)
        navigate_recording(material.imu, material.gps, material.spec, material.settings)  # compiles
        begin = clock.process_time()
        done = navigate_recording(material.imu, material.gps, material.spec, material.settings)
        cpu = clock.process_time() - begin
    except InsnavError as error:
        return [_failed(case.name, "insnav", error)]
    per_sample = 1e6 * cpu / len(material.imu.time)
    rows.append(_row(case.name, "insnav", done.run.solution, material, per_sample))
    if done.run.smoothed is not None:
        rows.append(_row(case.name, "insnav, smoothed", done.run.smoothed.solution, material, None))
    task = task_of(material, ready)
    for name, run in installed().items():
        try:
            peer = run(task)
            rows.append(_row(case.name, name, peer.solution, material, 1e6 * peer.cpu_s / peer.samples))
        except Exception as error:  # whatever a peer may raise is its result
            rows.append(_failed(case.name, name, error))
    return rows


def _failed(case: str, program: str, error: Exception) -> PeerRow:
    text = str(error).splitlines()[0] if str(error) else type(error).__name__
    return PeerRow(case, program, (None,) * 3, (None, None), None, f"fails: {text[:60]}")


def _row(case: str, program: str, solution: Trajectory, material: Material, cpu_us: float | None) -> PeerRow:
    time = settled(solution, material)
    if len(solution.time) > 1 and np.median(np.diff(solution.time)) > _SPARSE:
        at = np.clip(np.searchsorted(solution.time, time - _SAME), 0, len(solution.time) - 1)
        near = np.abs(solution.time[at] - time) < _SAME
        chosen = np.isin(material.truth.time, time[near])
        material, time = replace(material, truth=material.truth.rows(chosen)), time[near]
    if not len(time):
        return PeerRow(case, program, (None,) * 3, (None, None), cpu_us, "no epoch in common with the reference")
    errors = errors_of(solution, time, material)
    level = np.linalg.norm(errors.attitude[:, :2], axis=1)
    columns = (*errors.position.T, level / DEG, errors.attitude[:, 2] / DEG)
    figures = [rms(column) if np.isfinite(column).any() else None for column in columns]
    return PeerRow(case, program, tuple(figures[:3]), tuple(figures[3:]), cpu_us)


def _begun(whole: Material) -> tuple[Material, Prepared]:
    """As short a first part of a drive as it can be aligned by, and with a reference for it."""
    seconds = LONGEST
    while True:
        part = shortened(whole, seconds)
        last = whole.imu.time[0] + seconds > whole.imu.time[-1]
        try:
            ready = prepare(part.imu, part.gps, part.spec, part.settings)
            moving = part.gps.v_n[part.gps.time > ready.initial.time + LATEST]
            if last or part.min_speed == 0.0 or (np.linalg.norm(moving, axis=1) > part.min_speed).sum() >= LATEST:
                return part, ready
        except AlignmentError:
            if last:
                raise
        seconds *= 2.0


def shortened(material: Material, seconds: float) -> Material:
    """The first part of a recording."""
    imu, gps = material.imu, material.gps
    n, m = (int(np.searchsorted(time, imu.time[0] + seconds)) for time in (imu.time, gps.time))
    settle = min(material.settle, LATEST)
    return replace(material, imu=imu.rows(slice(n)), gps=gps.rows(slice(m)), settle=settle)


def task_of(material: Material, ready: Prepared) -> Task:
    """What a peer is given, by what insnav starts from."""
    initial = ready.initial
    sd = np.sqrt(np.diag(initial.covariance)[:9])
    gps = ready.gps
    good = gps.time > initial.time + 1e-6
    if gps.fix is not None:
        good &= gps.fix != 0
    return Task(
        ready.imu, gps.rows(good), initial.time, initial.lla, initial.v_n, initial.rph, sd[:3], sd[3:6], sd[6:9],
        material.settings.lever_b, material.spec,
    )  # fmt: skip
