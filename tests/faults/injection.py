"""Put every fault of the matrix into simulated and recorded drives, navigate as a user would, and say what came of it.

``python -m tests.faults.injection TABLE.csv [--drives NAME,...] [--rows N1,...] [--minutes 9]`` goes on with a table
where it stopped, and prints the counts. Outcomes, worst first:

======== ===========================================================================================
crash    another exception than those of insnav (exit code 70)
silent   over-confident, and nothing new was said
events   over-confident, and only ``events.csv`` has something new
stated   over-confident, but smaller than what the run itself states that it would not show
note     over-confident, and only a note on the page has something new
warned   over-confident, and a warning is new
told     as sure as it should be, and a warning is new
good     as sure as it should be
refused  an error with its exit code (1 for a filter that is lost)
======== ===========================================================================================

Over-confident: less than 95 % of the coordinates of the smoothed position inside three standard deviations, and less
than without the fault. New are findings whose code and subject none had without the fault.
"""

from __future__ import annotations

import argparse
import csv
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import takewhile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import insnav
from insnav.attitude import dcm_from_rph
from insnav.earth import lla_offset, ned_offset
from insnav.errors.evaluated_run import failure
from insnav.exceptions import InsnavError
from insnav.findings import CORRELATED_POSITIONS, Code, Finding, Severity, is_shown, of_code, of_families
from insnav.input import read_gps, read_imu, read_reference
from insnav.messages import sentence
from insnav.output.data_files import write_data
from insnav.session.simulation import plan_of, profiled
from insnav.simulate.recording import parse_fault
from insnav.types import GpsData, ImuData, Trajectory
from tests.shared import DATA

LEVER = Code.ESTIMATE_LEVER_ARM_CHECKED  # the smallest errors of the lever arm given that a run would have shown
BEGIN = 100.0  # of the faults, after the first sample [s]
OUTCOMES = ("crash", "silent", "events", "stated", "note", "warned", "told", "good", "refused")
HOLDS, WORSE = 0.95, 0.02
# no news: what a run would not have shown, its noise, and what nobody gave
ROUTINE = CORRELATED_POSITIONS | of_families("imu_model")
ROUTINE |= {
    LEVER,
    Code.GPS_DETECTABLE,
    Code.ESTIMATE_NOISE,
    Code.ESTIMATE_NOISE_PRESET,
    Code.ESTIMATE_POSITION_SD,
    Code.ESTIMATE_VELOCITY_SD,
    Code.RUN_LEVER_ZERO,
    Code.RUN_SLOW_ERRORS,
}


@dataclass(frozen=True)
class Data:
    """A drive without a fault, and what is known of its motion."""

    imu: ImuData
    gps: GpsData
    truth: Trajectory | None  # None: the smoothed solution without the fault stands for it


@dataclass(frozen=True)
class Case:
    """A fault of one size."""

    row: str  # of the matrix
    name: str
    apply: Callable[[Data], tuple[ImuData, GpsData]]
    inputs: dict[str, Any] = field(default_factory=dict)
    shift: float = 0.0  # by which the times of the fixes are off, and so those of the solution [s]
    # a size that the run states it would not show: one of those of `gps.detectable`, or the first number of a finding
    seen: int | Code | None = None


# --- drives ------------------------------------------------------------------------------------------------


def _simulated(profile: str, imu: str, gps: str, seed: int, span: tuple[float, float], keep: str = "") -> Data:
    made = plan_of(profiled(profile, seed), {"imu": imu, "gps": gps, "seed": seed}).measured()
    fixes, begin = made.gps, float(made.imu.time[0])
    if keep == "positions":
        fixes = replace(fixes, v_n=np.full_like(fixes.v_n, np.nan), velocity_sd=np.full_like(fixes.v_n, np.nan))
    return _piece(made.imu, fixes, made.reference, begin + span[0], begin + span[1])


def _piece(imu: ImuData, gps: GpsData, truth: Trajectory | None, begin: float, end: float) -> Data:
    inside = imu.time[(imu.time >= begin) & (imu.time <= end)]
    return Data(
        imu.rows((imu.time >= begin) & (imu.time <= end)), gps.rows((gps.time >= inside[0]) & (gps.time <= end)), truth
    )


def _recorded(name: str, begin: float, length: float) -> Data:
    folder = DATA / name
    imu = read_imu(next(folder.glob("imu.csv*"))).data
    if (folder / "gps.csv").is_file():
        gps = read_gps(folder / "gps.csv").data
    else:
        ref = read_reference(folder / "ref.csv").data
        unknown = np.full_like(ref.lla, np.nan)
        gps = GpsData(ref.time, ref.lla, ref.v_n, unknown, unknown).rows(slice(None, None, 10))
    start = float(imu.time[0]) + begin
    return _piece(imu, gps, None, start, start + length)


DRIVES: dict[str, Callable[[], Data]] = {
    "short": lambda: _simulated("round_trip", "automotive", "single", 21, (0.0, 173.0)),
    "city": lambda: _simulated("city", "automotive", "single", 11, (0.0, 300.0)),
    "motorway": lambda: _simulated("motorway", "consumer", "urban", 12, (60.0, 360.0)),
    "tactical": lambda: _simulated("mountain_road", "tactical", "rtk", 13, (0.0, 240.0)),
    "aircraft": lambda: _simulated("aircraft_pattern", "industrial", "dgps", 14, (0.0, 300.0)),
    "positions": lambda: _simulated("city", "consumer", "single", 15, (100.0, 400.0), "positions"),
    "mountain": lambda: _simulated("mountain_road", "consumer", "dgps", 103, (100.0, 400.0)),
    "figure": lambda: _simulated("figure_eight", "automotive", "rtk", 105, (0.0, 240.0)),
    "town": lambda: _simulated("city", "automotive", "rtk", 205, (0.0, 240.0)),
    "rtklib": lambda: _recorded("rtklib_drive_20250708", 200.0, 300.0),
    "rtklib_2": lambda: _recorded("rtklib_drive_20250708", 20.0, 180.0),
    "ixr": lambda: _recorded("ixr_tsukishima_20210412", 300.0, 240.0),
    "uav": lambda: _recorded("umn_thor75_uav", 200.0, 300.0),
    "fog": lambda: _recorded("psins_fog_mems_100s", 0.0, 100.0),
}


@lru_cache(maxsize=2)
def drive(name: str) -> Data:
    """A drive by its name."""
    return DRIVES[name]()


# --- faults ------------------------------------------------------------------------------------------------


def _verb(text: str) -> Callable[[Data], tuple[ImuData, GpsData]]:
    return lambda data: parse_fault(text.format(b=f"@{_begin(data):g}s")).apply(data.imu, data.gps)


def _begin(data: Data) -> float:
    return min(BEGIN, 0.4 * float(np.ptp(data.imu.time)))


def _during(data: Data, time: np.ndarray, length: float) -> np.ndarray:
    begin = float(data.imu.time[0]) + _begin(data)
    return np.asarray((time >= begin) & (time < begin + length))


def _gps(change: Callable[[GpsData, np.ndarray], GpsData], length: float = np.inf) -> Callable[..., Any]:
    """Change of the fixes in a while."""
    return lambda data: (data.imu, change(data.gps, _during(data, data.gps.time, length)))


def _imu(change: Callable[[ImuData, np.ndarray], ImuData], length: float = np.inf) -> Callable[..., Any]:
    """Change of the samples in a while."""
    return lambda data: (change(data.imu, _during(data, data.imu.time, length)), data.gps)


def _frozen(gps: GpsData, inside: np.ndarray) -> GpsData:
    lla = gps.lla.copy()
    lla[inside] = lla[np.flatnonzero(inside)[0]]
    return replace(gps, lla=lla)


def _repeated(gps: GpsData, times: int) -> GpsData:
    """Each fix in so many rows, as in a log that is faster than its receiver."""
    step = np.diff(gps.time, append=2.0 * gps.time[-1] - gps.time[-2])
    rows = gps.rows(np.repeat(np.arange(gps.time.size), times))
    return replace(rows, time=rows.time + np.tile(np.arange(times), gps.time.size) * np.repeat(step, times) / times)


def _dragged(gps: GpsData, inside: np.ndarray, rate: float) -> GpsData:
    off = rate * (gps.time - gps.time[inside][0]) * inside
    off[gps.time > gps.time[inside][-1]] = off[inside][-1]
    way = np.array([0.6, 0.8, 0.0])
    return replace(gps, lla=lla_offset(gps.lla, off[:, None] * way), v_n=gps.v_n + rate * inside[:, None] * way)


def _stepped(imu: ImuData, inside: np.ndarray, gyro: float, accel: float) -> ImuData:
    scale = float(np.median(np.diff(imu.time))) if imu.sampling == "increment" else 1.0
    add = scale * inside[:, None]
    return replace(imu, gyro=imu.gyro + gyro * add * [0, 0, 1.0], accel=imu.accel + accel * add * [1.0, 0, 0])


def _thinned(imu: ImuData, inside: np.ndarray) -> ImuData:
    keep = ~inside | (np.random.default_rng(1).random(inside.size) < 0.5)
    return imu.rows(np.asarray(keep))


def _clipped(imu: ImuData, inside: np.ndarray, part: float) -> ImuData:
    limit = part * np.abs(imu.gyro[inside]).max(axis=0)
    return replace(imu, gyro=np.where(inside[:, None], np.clip(imu.gyro, -limit, limit), imu.gyro))


def _stuck_often(data: Data, axis: int, seconds: float, times: int) -> tuple[ImuData, GpsData]:
    values = np.hstack([data.imu.gyro, data.imu.accel])
    for number in range(times):
        rows = np.flatnonzero(_during(data, data.imu.time - 12.0 * number, seconds))
        values[rows, axis] = values[rows[:1], axis]
    return replace(data.imu, gyro=values[:, :3].copy(), accel=values[:, 3:].copy()), data.gps


def _turned(imu: ImuData, rph_deg: tuple[float, float, float]) -> ImuData:
    turn = dcm_from_rph(np.deg2rad(rph_deg))
    return replace(imu, gyro=imu.gyro @ turn, accel=imu.accel @ turn)


def _lever(data: Data, forward: float) -> tuple[ImuData, GpsData]:
    """An antenna so far ahead of where it was; without exact motion nothing changes."""
    gps, truth = data.gps, data.truth
    if truth is None:
        return data.imu, gps
    ahead = dcm_from_rph(truth.rph)[:, :, 0] * forward
    moved, faster = (
        np.column_stack([np.interp(gps.time, truth.time, column) for column in each.T])
        for each in (ahead, np.gradient(ahead, truth.time, axis=0))
    )
    return data.imu, replace(gps, lla=lla_offset(gps.lla, moved), v_n=gps.v_n + faster)


def _shifted(seconds: float) -> Callable[[Data], tuple[ImuData, GpsData]]:
    return lambda data: (data.imu, replace(data.gps, time=data.gps.time + seconds))


def cases() -> Iterator[Case]:
    """Every fault in its sizes."""

    def sized(
        row: str, name: str, sizes: tuple[Any, ...], make: Callable[[Any], Any], seen: int | None = None
    ) -> Iterator[Case]:
        for size in sizes:
            yield Case(row, f"{name} {size}", make(size), seen=seen)

    yield from sized("N1", "spike", ("10m", "1000m", "100km"), lambda s: _verb(f"gps-spike:{s}{{b}}"))
    yield from sized("N1", "first fix", ("30m", "300m", "1100m"), lambda s: _verb(f"gps-spike:{s}@0s"))
    yield from sized("N2", "jump 8 s", ("3m", "20m", "60m"), lambda s: _verb(f"gps-jump:{s}{{b}}+8s"), 0)
    yield from sized("N2", "jump 30 s", ("3m", "30m", "300m"), lambda s: _verb(f"gps-jump:{s}{{b}}+30s"), 0)
    yield from sized("N3", "jump for good", ("3m", "20m", "500m"), lambda s: _verb(f"gps-jump:{s}{{b}}"), 0)
    yield from sized("N3", "frozen [s]", (2, 5, 20, 60), lambda s: _gps(_frozen, s))
    yield from sized("N4", "drag 60 s", ("0.2m/s", "1m/s", "2m/s"), lambda s: _verb(f"gps-drag:{s}{{b}}+60s"), 2)
    yield from sized("N4", "drag with v", (0.2, 1.0, 5.0), lambda s: _gps(lambda g, i: _dragged(g, i, s), 60.0), 1)
    yield from sized("N5", "outage [s]", (5, 20, 60), lambda s: _verb(f"gps-outage{{b}}+{s}s"))
    yield from sized("N6", "flapping", ("5m", "50m", "300m"), lambda s: _verb(f"gps-flap:{s}{{b}}+40s"))
    yield from sized("N6", "sd factor", (0.3, 0.1, 0.01), lambda s: _verb(f"gps-sd:{s}"))
    for late in (0.1, 0.4, 1.5):
        yield Case("N7", f"latency {late}", _verb(f"gps-latency:{late}s"), shift=late)
    yield from sized("N8", "shuffled [s]", (3, 10, 30), lambda s: _verb(f"gps-shuffle{{b}}+{s}s"))
    yield Case("N9", "fix twice", _verb("gps-duplicate{b}"))
    yield from sized("N9", "rows a fix", (2, 10), lambda s: lambda data: (data.imu, _repeated(data.gps, s)))
    yield from sized("N9", "samples twice [s]", (0.1, 1, 10), lambda s: _verb(f"imu-duplicate{{b}}+{s}s"))
    yield Case("N10", "clock back", _verb("imu-reverse{b}"))
    yield from sized("N11", "gap [s]", (0.3, 2, 10), lambda s: _verb(f"imu-gap{{b}}+{s}s"))
    yield from sized("N11", "half the samples [s]", (2, 20, 60), lambda s: _imu(_thinned, s))
    yield from sized("N12", "no numbers [s]", (0.05, 0.5, 5), lambda s: _verb(f"imu-nan{{b}}+{s}s"))
    yield from sized("N13", "gyros clipped at", (0.8, 0.5, 0.2), lambda s: _imu(lambda i, w: _clipped(i, w, s), 60.0))
    for axis in ("gyro-z", "accel-x", "all"):
        yield from sized("N14", f"stuck {axis} [s]", (1, 4, 15), lambda s, a=axis: _verb(f"imu-stuck:{a}{{b}}+{s}s"))
    yield from sized("N14", "gyro z stuck [times]", (3, 4, 8), lambda s: lambda data: _stuck_often(data, 2, 3.0, s))
    yield from sized("N15", "spike", ("3rad/s", "30m/s^2", "300m/s^2"), lambda s: _verb(f"imu-spike:{s}{{b}}"))
    yield from sized(
        "N15", "gyro step [deg/s]", (0.1, 0.5, 3), lambda s: _imu(lambda i, w: _stepped(i, w, np.deg2rad(s), 0))
    )
    yield from sized("N15", "accel step [m/s^2]", (0.1, 0.5, 3), lambda s: _imu(lambda i, w: _stepped(i, w, 0, s)))
    yield from sized("N16", "units", ("deg/s", "g"), lambda s: _verb(f"imu-units:{s}"))
    yield from sized("N17", "axes", ("FLU", "BLD", "RDF"), lambda s: _verb(f"imu-axes:{s}"))
    yield from sized("N17", "axes left-handed", ("FLD", "RFD", "FRU"), lambda s: _verb(f"imu-axes:{s}"))
    for turn in ((0, 0, 5), (0, 0, 30), (0, -35, 0), (0, -10, 0), (180, 0, 0)):
        yield Case("N17", f"turned {turn}", lambda data, t=turn: (_turned(data.imu, t), data.gps))
    yield from sized("N18", "antenna ahead [m]", (1, 2, 5), lambda s: lambda data: _lever(data, s))
    for arm in (1.0, 2.0, 5.0):
        yield Case(
            "N18",
            f"lever arm given wrong {arm}",
            lambda data: (data.imu, data.gps),
            {"lever_arm": (arm, 0, 0)},
            seen=LEVER,
        )
    for late in (1.0, 10.0, 18.0):
        yield Case("N20", f"fixes off by {late} s", _shifted(late), shift=late)
    yield Case("N20", "fixes early by 18 s", _shifted(-18.0), shift=-18.0)
    yield Case("N25", "heading given wrong", lambda data: (data.imu, data.gps), {"heading": "wrong"})
    yield from sized("N28", "sd factor", (0.001, 100), lambda s: _verb(f"gps-sd:{s}"))
    confused = {
        "velocity ENU": lambda g, i: replace(g, v_n=g.v_n[:, [1, 0, 2]] * [1, 1, -1]),
        "velocity sign": lambda g, i: replace(g, v_n=-g.v_n),
        "velocity zero": lambda g, i: replace(g, v_n=0.0 * g.v_n),
        "velocity km/h": lambda g, i: replace(g, v_n=3.6 * g.v_n),
        "velocity down is up": lambda g, i: replace(g, v_n=g.v_n * [1, 1, -1]),
        "heights zero": lambda g, i: replace(g, lla=g.lla * [1, 1, 0]),
        "exchanged": lambda g, i: replace(g, lla=g.lla[:, [1, 0, 2]]),
        "radians": lambda g, i: replace(g, lla=g.lla * [np.pi / 180, np.pi / 180, 1]),
    }
    for name, change in confused.items():
        yield Case("N20", name, _gps(change))
    yield from sized(
        "N6",
        "velocity off 30 s [m/s]",
        (1, 5, 50),
        lambda s: _gps(lambda g, i: replace(g, v_n=g.v_n + s * i[:, None]), 30.0),
    )
    yield from sized(
        "N6", "velocity zero [s]", (5, 20, 60), lambda s: _gps(lambda g, i: replace(g, v_n=g.v_n * ~i[:, None]), s)
    )


# --- what came of it ---------------------------------------------------------------------------------------


Key = tuple[Code, str]  # code and subject


@dataclass(frozen=True)
class Outcome:
    """What a run said and how true it was."""

    kind: str
    inside: float = np.nan  # share of the smoothed position inside 3 sd
    largest: float = np.nan  # horizontal deviation [m]
    words: str = ""
    seconds: float = np.nan
    codes: frozenset[Code] = frozenset()  # of the findings that are new


@dataclass(frozen=True)
class Clean:
    """A run without a fault."""

    inside: float
    said: tuple[dict[Key, Finding], ...]  # warnings, notes, what only ``events.csv`` has
    truth: Trajectory
    heading: float  # [rad]


def navigated(imu: ImuData, gps: GpsData, inputs: dict[str, Any]) -> Any:
    """Run over files, as a user would."""
    with TemporaryDirectory() as folder:
        write_data(Path(folder) / "imu.csv", imu)
        write_data(Path(folder) / "gps.csv", gps)
        drive = insnav.load(
            Path(folder) / "imu.csv", Path(folder) / "gps.csv", sampling=imu.sampling, stamp=imu.stamp, **inputs
        )
    return drive.navigate()


def _said(result: Any) -> tuple[dict[Key, Finding], ...]:
    """Warnings, notes and what only ``events.csv`` has, by code and subject, numbers aside."""
    of_files = {finding for facts in result.inputs.values() for finding in facts.evidence}
    news = [each for each in result.findings if each.code not in ROUTINE and each not in of_files]
    shown = [each for each in news if is_shown(each)]

    def keyed(findings: Iterable[Finding]) -> dict[Key, Finding]:
        return {(each.code, each.subject): each for each in findings}

    return (
        keyed(each for each in shown if each.severity >= Severity.WARNING),
        keyed(each for each in shown if each.severity < Severity.WARNING),
        keyed(each for each in news if not is_shown(each)),
    )


def _number(text: str) -> float:
    """The first number of the size of a fault, without its unit."""
    return float("".join(takewhile("0123456789.".__contains__, text)))


def _seen(result: Any, of: int | Code) -> float:
    """Size that a run states it would not show."""
    if isinstance(of, int):
        name = ("jump_m", "drift_m_s", "minute_m_s")[of]
        return next(
            (float(dict(note.values).get(name, np.inf)) for note in of_code(result.findings, Code.GPS_DETECTABLE)), 0.0
        )
    return next((float(note["detectable_m"][0]) for note in of_code(result.findings, of)), 0.0)


def _inside(solution: Trajectory, truth: Trajectory, shift: float) -> tuple[float, float]:
    """Share of the coordinates inside 3 sd, and the largest horizontal deviation [m]."""
    at = solution.time - shift
    rows = (at >= truth.time[0]) & (at <= truth.time[-1])
    lla = np.column_stack([np.interp(at[rows], truth.time, column) for column in truth.lla.T])
    off = ned_offset(solution.lla[rows], lla)
    sd = solution.sd[rows, :3]
    if truth.sd is not None:
        sd = np.hypot(sd, np.column_stack([np.interp(at[rows], truth.time, column) for column in truth.sd[:, :3].T]))
    return float(np.mean(np.abs(off) <= 3.0 * sd)), float(np.hypot(off[:, 0], off[:, 1]).max())


@lru_cache(maxsize=2)
def clean(name: str) -> Clean:
    """The run of a drive without a fault."""
    data = drive(name)
    result = navigated(data.imu, data.gps, {})
    smoothed = result.found.run.smoothed.solution
    truth = data.truth or smoothed
    return Clean(_inside(smoothed, truth, 0.0)[0], _said(result), truth, float(result.found.run.alignment.rph[2]))


def outcome(name: str, case: Case) -> Outcome:
    """Navigate a drive with a fault."""
    begin, before, data = time.process_time(), clean(name), drive(name)
    inputs = dict(case.inputs)
    if "heading" in inputs:
        inputs["heading"] = before.heading + np.pi - 2.0 * np.pi * (before.heading > 0.0)
    try:
        result = navigated(*case.apply(data), inputs)
    except InsnavError as error:
        text = f"{error.exit_code} {error.what}"
        return Outcome("refused", words=text, seconds=time.process_time() - begin)
    except Exception as error:  # what a user must never see
        where = traceback.extract_tb(error.__traceback__)[-1]
        return Outcome("crash", words=f"{type(error).__name__} {error} {Path(where.filename).name}:{where.lineno}")
    run, seconds = result.found.run, time.process_time() - begin
    inside, largest = _inside(run.smoothed.solution, before.truth, case.shift)
    warnings, notes, events = (
        [finding for key, finding in now.items() if key not in then]
        for now, then in zip(_said(result), before.said, strict=True)
    )
    codes = [" ".join(filter(None, each)) for each in sorted((each.code, each.subject) for each in (*notes, *events))]
    words = " | ".join([*sorted(map(sentence, warnings)), *(f"({text})" for text in codes)])
    found = frozenset(each.code for each in (*warnings, *notes, *events))
    if lost := failure(run):
        return Outcome("refused", inside, largest, f"1 {sentence(lost)}", seconds, found | {lost.code})
    if inside < HOLDS and inside < before.inside - WORSE:
        stated = case.seen is not None and _number(case.name.rpartition(" ")[2]) < _seen(result, case.seen)
        kind = "warned" if warnings else "note" if notes else "stated" if stated else "events" if events else "silent"
    else:
        kind = "told" if warnings else "good"
    return Outcome(kind, inside, largest, words, seconds, found)


def main() -> None:
    """Go on with a table of outcomes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", type=Path)
    parser.add_argument("--drives", default=",".join(DRIVES))
    parser.add_argument("--rows", default="")
    parser.add_argument("--minutes", type=float, default=np.inf)
    given = parser.parse_args()
    rows = list(csv.reader(given.table.open(encoding="utf-8"))) if given.table.exists() else []
    done, end = {(row[0], row[2]) for row in rows}, time.monotonic() + 60.0 * given.minutes
    with given.table.open("a", newline="", encoding="utf-8") as file:
        for name in given.drives.split(","):
            for case in cases():
                if (name, case.name) in done or (given.rows and case.row not in given.rows.split(",")):
                    continue
                if time.monotonic() > end:
                    break
                found = outcome(name, case)
                row = [name, case.row, case.name, found.kind, f"{found.inside:.3f}", f"{found.largest:.2f}"]
                rows.append([*row, f"{found.seconds:.1f}", found.words])
                csv.writer(file).writerow(rows[-1])
                file.flush()
    keys = sorted({row[1] for row in rows}, key=lambda key: (key[0], int(key[1:])))
    counts = Counter((row[1], row[3]) for row in rows)
    print(f"{'':<5}" + "".join(f"{kind:>9}" for kind in OUTCOMES))
    for key in keys:
        print(f"{key:<5}" + "".join(f"{counts[key, kind]:>9}" for kind in OUTCOMES))
    print(f"{'':<5}" + "".join(f"{sum(row[3] == kind for row in rows):>9}" for kind in OUTCOMES))


if __name__ == "__main__":
    main()
