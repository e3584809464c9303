"""Compare with other programs on the same drives, and with published outage results: ``python reports/peers.py``.

The programs are pyins (a filter) and GTSAM (a batch smoother), if installed.

A published test is simulated. A replica has only the published figures of the IMU, a motion of the same kind, RTK
fixes, and the published statistic. Field factor: recorded over predicted error. It includes the effect of unpublished
figures.
"""

from __future__ import annotations

import argparse
import importlib.util
import math
import time as clock
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pymap3d
import scipy
from jinja2 import Environment, StrictUndefined

from insnav.attitude import dcm_from_rph
from insnav.config_file import Table, read_toml, scalar, validate
from insnav.earth import OMEGA_EARTH, gravity_n
from insnav.engine import Workers, every
from insnav.exceptions import AlignmentError, InsnavError
from insnav.filter.filter_input import FilterInput
from insnav.filter.navigate import navigate_recording
from insnav.filter.prepare import Start, prepare
from insnav.imu import ImuSpec, load_imu
from insnav.imu.specification import SensorSpec
from insnav.output.folder import write_text
from insnav.quantity import Quantity
from insnav.regression.baseline import BASELINE_FILE, Origin, origin, read_baseline
from insnav.regression.corpus import Corpus, Material, RecordedCase, default_corpus, load_corpus, source_of
from insnav.regression.evaluate import SERIES, AnyCase, errors_of, run_corpus, settled
from insnav.report.html import page_html
from insnav.report.page import Cell, Matrix, Page, Section, section_tables
from insnav.report.regression.page import PEERS, SECTION, made_line, markdown_table
from insnav.report.style import number
from insnav.report.terminal import table_text
from insnav.sample_statistics import rms
from insnav.session.simulation import simulate
from insnav.simulate.montecarlo import run_seed
from insnav.types import FloatArray, GpsData, ImuData, IntArray, Trajectory
from insnav.units import DEG

REPORTS = Path(__file__).parent
PAGE, FILE = "peers.html", "published.md"
_WARM = 2.0  # part of the drive for compilation [s]
_INTEGRATION = 1e-8  # covariance of GTSAM's integration of position, as in its examples [m^2/s]
_DEGREES = np.array([DEG, DEG, 1.0])
LONGEST = 150.0  # of a drive: pyins needs a quarter of a minute for it [s]
LATEST = 80.0  # latest start of the evaluated errors [s]
_SPARSE = 0.5  # a solution with longer steps is evaluated at its own epochs only [s]
_SAME = 5e-3  # largest distance from an epoch [s]
SEEDS = 3  # drives per replica
FIRST, SPACING = 120.0, 15.0  # of the outages in a drive [s]
_TIE = 0.1  # relative difference of a peer that counts as equal
_AXES = ("north", "east", "down", "tilt", "heading")
_NOTE = (
    f"RMS over the first {LONGEST:g} s of the first drive of each case, longer if the heading needs it. From "
    f"{LATEST:g} s on at the latest. Samples, fixes, start and sensor figures are equal. gtsam: at the fixes only"
)
Statistic = Literal["RMS of maxima", "RMS at the end", "mean at the end", "maximum"]


@dataclass(frozen=True, slots=True)
class Task:
    """Input of a peer."""

    imu: ImuData  # mean rates and specific forces, stamped at the end
    gps: GpsData  # fixes after the start, with the standard deviation of each
    start: Start
    lever_b: FloatArray  # (3,) antenna seen from the IMU, body axes [m]
    spec: ImuSpec  # sensor specification


@dataclass(frozen=True, slots=True)
class PeerRun:
    """Result of a peer."""

    cpu_s: float  # CPU time of the filter alone [s]
    samples: int  # filtered
    solution: Trajectory  # without standard deviations


def _bias_sd(sensor: SensorSpec) -> FloatArray:
    return np.hypot(sensor.bias, sensor.bias_instability)


def _bias_walk(sensor: SensorSpec) -> FloatArray:
    """Compute the driving noise of the in-run bias process, which the peers model as a random walk."""
    return np.asarray(sensor.bias_instability * np.sqrt(2.0 / sensor.correlation_time))


def _increments(imu: ImuData) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute length, angle and velocity increment of each sampling interval."""
    step = np.diff(imu.time, prepend=2.0 * imu.time[0] - imu.time[1])
    scale = 1.0 if imu.sampling == "increment" else step[:, None]
    return step, imu.gyro * scale, imu.accel * scale


def run_pyins(task: Task) -> PeerRun:
    """Filter with pyins; compilation and table building are not timed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings of its pandas use are irrelevant here
        _pyins(task, task.start.time + _WARM)
        return _pyins(task, float("inf"))


def _pyins(task: Task, end: float) -> PeerRun:
    import pandas as pd
    from pyins import filters, inertial_sensor, measurements, strapdown
    from pyins.util import ACCEL_COLS, GYRO_COLS, LLA_COLS, RPH_COLS, VEL_COLS

    imu, gps = task.imu, task.gps
    rows = (imu.time > task.start.time - 1e-6) & (imu.time < end)  # pyins needs one earlier sample
    _, dtheta, dvel = _increments(imu)
    table = pd.DataFrame(np.hstack([dtheta, dvel])[rows], index=imu.time[rows], columns=GYRO_COLS + ACCEL_COLS)
    increments = strapdown.compute_increments_from_imu(table, "increment")
    inside = (gps.time > task.start.time + 1e-6) & (gps.time <= increments.index[-1])
    used: list[measurements.Measurement] = []
    for kind, value, sd, columns in (
        (measurements.Position, gps.lla / _DEGREES, gps.position_sd, LLA_COLS),
        (measurements.NedVelocity, gps.v_n, gps.velocity_sd, VEL_COLS),
    ):
        known = inside & np.isfinite(value).all(axis=1)
        if known.any():
            measured = kind(pd.DataFrame(value[known], index=gps.time[known], columns=columns), 1.0, task.lever_b)
            measured.R = np.diag(np.mean(sd[known] ** 2, axis=0))  # the constructor accepts one value for all axes
            used.append(measured)
    gyro, accel = (
        inertial_sensor.EstimationModel(_bias_sd(s), s.random_walk, _bias_walk(s), np.diag(s.scale_factor))
        for s in (task.spec.gyro, task.spec.accel)
    )
    state = np.concatenate([task.start.lla / _DEGREES, task.start.v_n, task.start.rph / DEG])
    pva = pd.Series(state, index=LLA_COLS + VEL_COLS + RPH_COLS, name=task.start.time)
    level, heading = rms(task.start.attitude_sd[:2]) / DEG, float(task.start.attitude_sd[2]) / DEG
    begin = clock.process_time()
    result = filters.run_feedback_filter(
        pva, rms(task.start.position_sd), rms(task.start.velocity_sd), level, heading, increments, gyro, accel, used
    )
    cpu = clock.process_time() - begin
    found = result.trajectory
    solution = Trajectory(
        found.index.to_numpy(dtype=np.float64),
        found[LLA_COLS].to_numpy() * _DEGREES,
        found[VEL_COLS].to_numpy(),
        found[RPH_COLS].to_numpy() * DEG,
    )
    return PeerRun(cpu, len(increments), solution)


def run_gtsam(task: Task) -> PeerRun:
    """Smooth with GTSAM, in the tangent plane at the start (North, East, Down).

    Preintegrated IMU factors between the fixes, a factor for each position, biases as a random walk. Velocities of the
    fixes are not used: GTSAM has no velocity factor with a lever arm.
    """
    origin = task.start.lla / _DEGREES
    inside = (task.gps.time > task.start.time + 1e-6) & (task.gps.time <= task.imu.time[-1])
    fixes, sd = task.gps.time[inside], task.gps.position_sd[inside]
    ned = np.column_stack(pymap3d.geodetic2ned(*(task.gps.lla[inside] / _DEGREES).T, *origin))
    edges = np.searchsorted(task.imu.time, np.concatenate([[task.start.time], fixes]) + 1e-6)
    begin = clock.process_time()
    states = _gtsam(task, ned, sd, edges)
    cpu = clock.process_time() - begin
    position, v_n, rph = (np.array(part) for part in zip(*states, strict=True))
    lla = np.column_stack(pymap3d.ned2geodetic(*position.T, *origin)) * _DEGREES
    rph[:, 2] %= 2.0 * np.pi
    return PeerRun(cpu, int(edges[-1] - edges[0]), Trajectory(fixes, lla, v_n, rph))


def _gtsam(
    task: Task, ned: FloatArray, sd: FloatArray, edges: IntArray
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Return position, velocity and attitude at each fix."""
    import gtsam
    from gtsam.symbol_shorthand import B, V, X

    step, dtheta, dvel = _increments(task.imu)
    gyro, accel = dtheta / step[:, None], dvel / step[:, None]
    params = gtsam.PreintegrationParams.MakeSharedD(float(gravity_n(task.start.lla[0], task.start.lla[2])[2]))
    params.setGyroscopeCovariance(np.diag(task.spec.gyro.random_walk**2))
    params.setAccelerometerCovariance(np.diag(task.spec.accel.random_walk**2))
    params.setIntegrationCovariance(_INTEGRATION * np.eye(3))
    params.setOmegaCoriolis(OMEGA_EARTH * np.array([np.cos(task.start.lla[0]), 0.0, -np.sin(task.start.lla[0])]))
    sensors = (task.spec.accel, task.spec.gyro)  # in this order
    bias_sd = np.concatenate([_bias_sd(sensor) for sensor in sensors])
    walk = np.concatenate([_bias_walk(sensor) for sensor in sensors])

    def noise(sigmas: FloatArray) -> Any:
        return gtsam.noiseModel.Diagonal.Sigmas(sigmas)

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    pose = gtsam.Pose3(gtsam.Rot3(dcm_from_rph(task.start.rph)), np.zeros(3))
    state = gtsam.NavState(pose, task.start.v_n)
    zero = gtsam.imuBias.ConstantBias()
    pose_sd = np.concatenate([task.start.attitude_sd, task.start.position_sd])
    graph.add(gtsam.PriorFactorPose3(X(0), state.pose(), noise(pose_sd)))
    graph.add(gtsam.PriorFactorVector(V(0), state.velocity(), noise(task.start.velocity_sd)))
    graph.add(gtsam.PriorFactorConstantBias(B(0), zero, noise(bias_sd)))
    values.insert(X(0), state.pose())
    values.insert(V(0), state.velocity())
    values.insert(B(0), zero)
    measured = gtsam.PreintegratedImuMeasurements(params, zero)
    for k in range(len(edges) - 1):
        measured.resetIntegration()
        for i in range(edges[k], edges[k + 1]):
            measured.integrateMeasurement(accel[i], gyro[i], step[i])
        interval = float(step[edges[k] : edges[k + 1]].sum())
        graph.add(gtsam.ImuFactor(X(k), V(k), X(k + 1), V(k + 1), B(k), measured))
        graph.add(gtsam.BetweenFactorConstantBias(B(k), B(k + 1), zero, noise(walk * np.sqrt(interval))))
        graph.add(gtsam.GPSFactorArm(X(k + 1), ned[k], task.lever_b, noise(sd[k])))
        state = measured.predict(state, zero)
        # the fix is the better initial position: without it the first linearization is kilometres off
        state = gtsam.NavState(gtsam.Pose3(state.attitude(), ned[k]), state.velocity())
        values.insert(X(k + 1), state.pose())
        values.insert(V(k + 1), state.velocity())
        values.insert(B(k + 1), zero)
    found = gtsam.LevenbergMarquardtOptimizer(graph, values, gtsam.LevenbergMarquardtParams()).optimize()
    poses = [found.atPose3(X(k + 1)) for k in range(len(edges) - 1)]
    return [(pose.translation(), found.atVector(V(k + 1)), pose.rotation().rpy()) for k, pose in enumerate(poses)]


@dataclass(frozen=True, slots=True)
class PeerRow:
    """Result of one program on one case."""

    case: str
    program: str
    rms: tuple[float | None, ...]  # North, East, Down [m]
    attitude_deg: tuple[float | None, ...]  # roll and pitch together, heading [deg]
    cpu_us: float | None  # CPU time per sample [us]
    remark: str = ""  # reason for missing figures


def installed() -> dict[str, Callable[[Task], PeerRun]]:
    """Return the installed peers by name."""
    known = {"pyins": ("pyins", run_pyins), "gtsam, smoothed": ("gtsam", run_gtsam)}
    return {name: run for name, (module, run) in known.items() if importlib.util.find_spec(module) is not None}


def run_peers(corpus: Corpus, data: Path, *, workers: Workers = 1) -> list[PeerRow]:
    """Run insnav and every peer on the first part of every case's first drive.

    `data`: folder of recorded data; cases without data are skipped.
    """
    cases = [case for case in corpus.cases if not isinstance(case, RecordedCase) or (data / case.data).is_dir()]
    found = every(_compared, [(case, data) for case in cases], workers)
    return [row for rows in found for row in rows]


def _compared(of: tuple[AnyCase, Path]) -> list[PeerRow]:
    """Run every program on one case, with the folder of recorded data."""
    case, data = of
    whole = source_of(case, data).material(run_seed(SERIES, 1))
    rows = []
    try:
        material, ready = _begun(whole)
        navigate_recording(material.imu, material.gps, material.spec, material.receiver)  # compiles
        begin = clock.process_time()
        done = navigate_recording(material.imu, material.gps, material.spec, material.receiver)
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
        except Exception as error:  # any error of a peer is its result
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


def _begun(whole: Material) -> tuple[Material, FilterInput]:
    """Cut the shortest first part of a drive that can be aligned, with its reference."""
    seconds = LONGEST
    while True:
        part = shortened(whole, seconds)
        last = whole.imu.time[0] + seconds > whole.imu.time[-1]
        try:
            ready, _ = prepare(part.imu, part.gps, part.spec, part.receiver)
            moving = part.gps.v_n[part.gps.time > ready.initial.time + LATEST]
            if last or part.min_speed == 0.0 or (np.linalg.norm(moving, axis=1) > part.min_speed).sum() >= LATEST:
                return part, ready
        except AlignmentError:
            if last:
                raise
        seconds *= 2.0


def shortened(material: Material, seconds: float) -> Material:
    """Cut the first part of a recording."""
    imu, gps = material.imu, material.gps
    n, m = (int(np.searchsorted(time, imu.time[0] + seconds)) for time in (imu.time, gps.time))
    settle = min(material.settle, LATEST)
    return replace(material, imu=imu.rows(slice(n)), gps=gps.rows(slice(m)), settle=settle)


def task_of(material: Material, ready: FilterInput) -> Task:
    """Build the input of a peer from insnav's initial state."""
    initial, gps = ready.initial, ready.gps
    sd = np.sqrt(np.diag(initial.covariance)[:9])
    good = gps.time > initial.time + 1e-6
    if gps.fix is not None:
        good &= gps.fix != 0
    start = Start(initial.time, initial.lla, initial.v_n, initial.rph, sd[:3], sd[3:6], sd[6:9])
    return Task(ready.imu, gps.rows(good), start, material.receiver.lever_arm.value, material.spec)


class Case(Table):
    """Published result."""

    source: str
    where: str
    imu: str
    profile: str
    length: Annotated[float, scalar("time")]
    statistic: Statistic
    value: Annotated[float, scalar("length")]
    reason: str  # reason for the ratio
    aiding: bool = False  # NHC and ZUPT in the outage
    independent: bool = True  # from a separate test
    comparable: bool = True  # the replica has all aiding of the test


class _File(Table):
    case: list[Case]


@dataclass(frozen=True, slots=True)
class Compared:
    """Published result and its replica."""

    case: Case
    missing: tuple[str, ...]  # usual IMU figures that are unpublished, and absent in the replica
    replica: float  # the same statistic [m]
    interval: tuple[float, float]  # 95 % of an RMS of as many outages [m]
    outages: int

    @property
    def ratio(self) -> float:
        """Ratio of published to simulated error."""
        return self.case.value / self.replica


@dataclass(frozen=True, slots=True)
class FieldFactor:
    """Ratio of field errors to predicted errors."""

    ratios: Mapping[str, float]  # of every recorded drive and every independent published case
    typical: float  # geometric mean
    interval: tuple[float, float]  # its 95 % interval
    span: tuple[float, float]  # 95 % range of further drives' ratios


def read_cases() -> list[Case]:
    """Read the published results."""
    path = REPORTS / "published.toml"
    return validate(_File, read_toml(path), str(path)).case


def compare_published(cases: Sequence[Case], seeds: int = SEEDS) -> list[Compared]:
    """Simulate every case; cases of one test share a simulation. `seeds`: drives of a replica."""
    made = {test: errors_in_outages(*test, seeds=seeds) for test in dict.fromkeys(map(_test, cases))}
    return [_simulated(case, made[_test(case)]) for case in cases]


def _test(case: Case) -> tuple[str, str, float, bool]:
    return case.imu, case.profile, case.length, case.aiding


def errors_in_outages(imu: str, profile: str, length: float, aiding: bool, *, seeds: int) -> list[FloatArray]:
    """Simulate horizontal errors in outages, one array per outage [m]."""
    spec = load_imu(imu)
    found = []
    for seed in range(1, seeds + 1):
        drive = simulate(profile, imu=spec, gps="rtk", seed=seed)
        study = drive.outage(
            lengths=(length,), first=FIRST, spacing=SPACING, aiding="on" if aiding else "off", workers=1
        )
        found += [np.hypot(window.error[:, 0], window.error[:, 1]) for window in study.found.windows]
    return found


def statistic(kind: Statistic, errors: Sequence[FloatArray]) -> float:
    """Summarise horizontal outage errors by the statistic of a paper [m]."""
    ends, largest = np.array([each[-1] for each in errors]), np.array([each.max() for each in errors])
    if kind == "RMS of maxima":
        return float(rms(largest))
    if kind == "mean at the end":
        return float(ends.mean())
    return float(ends.max()) if kind == "maximum" else float(rms(ends))


def _simulated(case: Case, errors: Sequence[FloatArray]) -> Compared:
    value = statistic(case.statistic, errors)
    # outages of one drive overlap: the number that fits without overlap is independent
    count = max(2.0, len(errors) * min(1.0, SPACING / case.length))
    spread = 1.96 / math.sqrt(2.0 * count)
    interval = (value * math.exp(-spread), value * math.exp(spread))
    missing = tuple(key for key in load_imu(case.imu).absent if not key.endswith("correlation_time"))
    return Compared(case, missing, value, interval, len(errors))


def recorded_ratios(growth: Mapping[str, FloatArray]) -> dict[str, float]:
    """Compute the ratio of recorded to predicted horizontal error after a minute, by drive.

    `growth`: of each drive ``(n, 3)`` at increasing times, the last a minute: number of windows, sums of squared errors
    and of predicted variances [m^2].
    """
    return {
        name: math.sqrt(float(rows[-1, 1] / rows[-1, 2]))
        for name, rows in growth.items()
        if rows[-1, 0] > 0 and rows[-1, 2] > 0.0
    }


def field_factor(compared: Sequence[Compared], recorded: Mapping[str, float]) -> FieldFactor:
    """Compute the field factor: geometric mean, its interval and the range of further ratios, by Student's t."""
    ratios = dict(recorded)
    ratios |= {each.case.source: each.ratio for each in compared if each.case.independent and each.case.comparable}
    logs = np.log(list(ratios.values()))
    n = len(logs)
    mean, sd = float(logs.mean()), float(logs.std(ddof=1))
    quantile = float(scipy.special.stdtrit(n - 1, 0.975))
    own, further = quantile * sd / math.sqrt(n), quantile * sd * math.sqrt(1.0 + 1.0 / n)
    interval, span = ((math.exp(mean - half), math.exp(mean + half)) for half in (own, further))
    return FieldFactor(ratios, math.exp(mean), interval, span)


def peer_section(peers: Sequence[PeerRow]) -> Section:
    """Tabulate other programs on the same drives."""
    rows = tuple(
        (
            Quantity("case", row.case),
            Quantity("program", row.program),
            *(Quantity(axis, value, "m") for axis, value in zip("NED", row.rms, strict=True)),
            Quantity("tilt", row.attitude_deg[0], meaning="tilt [deg]"),  # already in degrees
            Quantity("heading", row.attitude_deg[1], meaning="heading [deg]"),
            Quantity("cpu", row.cpu_us, "us", meaning="CPU a sample"),
            Quantity("remark", row.remark),
        )
        for row in peers
    )
    return Section("", PEERS, rows=rows, note=_NOTE)


def peer_matrix(peers: Sequence[PeerRow]) -> Matrix | None:
    """Build the matrix of other programs' errors over insnav's on the same drive; None without any.

    Smoothers are compared with the smoother. One drive per case permits no significance test.
    """
    programs = list(dict.fromkeys(row.program for row in peers if not row.program.startswith("insnav")))
    figures = {(row.case, row.program): (*row.rms, *row.attitude_deg) for row in peers}
    own = list(dict.fromkeys(row.case for row in peers if row.program == "insnav"))
    columns = [(program, axis) for program in programs for axis in range(len(_AXES))]
    if not own or not columns:
        return None

    none = (None,) * len(_AXES)

    def cell(name: str, program: str, axis: int) -> Cell | None:
        base = "insnav, smoothed" if program.endswith("smoothed") else "insnav"
        a, b = (figures.get((name, each), none)[axis] for each in (base, program))
        return _peer_cell(name, program, _AXES[axis], a, b)

    rows = tuple((name, tuple(cell(name, *column) for column in columns)) for name in own)
    tones = (
        ("better2", "insnav has smaller errors"),
        ("same", f"within {100 * _TIE:g} %"),
        ("worse2", "insnav has larger errors"),
    )
    return Matrix(tuple(f"{program}, {_AXES[axis]}" for program, axis in columns), rows, tones)


def _peer_cell(case: str, program: str, axis: str, own: float | None, other: float | None) -> Cell | None:
    if own is None or other is None or not own > 0.0 or not np.isfinite(other):
        return None
    ratio = other / own
    tone = "same" if abs(np.log(ratio)) < np.log1p(_TIE) else "better2" if ratio > 1.0 else "worse2"
    unit = "deg" if axis in ("tilt", "heading") else "m"
    title = f"{case}, {axis}: {program} {number(other)} {unit}, insnav {number(own)} {unit}"
    return Cell(f"{ratio:.2g}", tone, title)


def section_lines(peers: Sequence[PeerRow], now: Origin) -> list[str]:
    """Write the table of other programs in Markdown, with its version."""
    title, *table = markdown_table(peer_section(peers))
    return [title, "", made_line(now, "python reports/peers.py"), *table]


def with_section(text: str, section: Sequence[str]) -> str:
    """Put the table of other programs into the accuracy section, before its rules."""
    lines = text.splitlines()
    rules = next((i for i, line in enumerate(lines) if line.startswith("- ")), len(lines))
    begin = lines.index(f"## {PEERS}") if f"## {PEERS}" in lines else rules
    return "\n".join([*lines[:begin], *section, *lines[rules:], ""])


def write_peers(folder: Path, peers: Sequence[PeerRow], now: Origin) -> None:
    """Write the table into the accuracy section, and a page with the ratios of the errors."""
    path, sections, matrix = folder / SECTION, [peer_section(peers)], peer_matrix(peers)
    write_text(path, with_section(path.read_text(encoding="utf-8"), section_lines(peers, now)))
    if matrix is not None:
        title = "Errors of other programs over errors of insnav, one drive each, smoothers over its smoother"
        sections.insert(0, Section("", title, matrix=matrix, show="page"))
    made = made_line(now, "python reports/peers.py")
    write_text(folder / PAGE, page_html(Page(f"insnav: {PEERS}", (made,), tuple(sections)), {}))


def write_published(
    folder: Path, compared: Sequence[Compared], recorded: Mapping[str, FloatArray], now: Origin
) -> None:
    """Write the published outage tests and the field factor; `recorded`: error growth of recorded drives."""
    lists = {
        "compared": compared,
        "missing": sorted({f"{each.case.imu}: {', '.join(each.missing)}" for each in compared if each.missing}),
        "places": sorted({f"{each.case.source.split(',')[0]}: {each.case.where}" for each in compared}),
    }
    environment = Environment(undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string((REPORTS / "published.md.j2").read_text(encoding="utf-8"))
    field = field_factor(compared, recorded_ratios(recorded))
    write_text(folder / FILE, template.render(field=field, now=now, number=number, **lists))


def recorded_growth(corpus: Corpus, data: Path) -> dict[str, FloatArray]:
    """Measure the error growth of every recorded drive, from the baseline where its data are absent."""
    baseline = read_baseline(REPORTS / BASELINE_FILE)
    recorded = corpus.model_copy(update={"simulated": []})
    cases = {} if baseline is None else dict(baseline.cases)
    found = run_corpus(recorded, data, workers="processes").cases
    cases |= {name: case for name, case in found.items() if case.measured.values}  # noqa: PD011
    return {each.name: cases[each.name].measured.growth for each in corpus.recorded if each.name in cases}


def main() -> None:
    """Measure, and write the pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("programs", "published"), help="one of the two comparisons; default: both")
    parser.add_argument("--corpus", type=Path, default=default_corpus(), help="the drives [trajectories/corpus.toml]")
    data = REPORTS.parents[1] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=data, help="recorded drives [shared/data next to the project]")
    parser.add_argument("--out", type=Path, default=REPORTS, help="folder of the pages [reports]")
    asked = parser.parse_args()
    corpus, now = load_corpus(asked.corpus), origin(REPORTS)
    if asked.only != "published":
        rows = run_peers(corpus, asked.data, workers="processes")
        print(*map(table_text, section_tables(peer_section(rows))), sep="\n")
        write_peers(asked.out, rows, now)
    if asked.only != "programs":
        write_published(asked.out, compare_published(read_cases()), recorded_growth(corpus, asked.data), now)


if __name__ == "__main__":
    main()
