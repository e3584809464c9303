"""Mutated recordings of each format through the whole of insnav, and how many ended in a defect or silently wrong.

``python -m tests.input.mutations [--count 200] [--seed 1] [--log LOG] [FORMAT ...]`` writes a simulated drive in each
format, changes it at random (a digit, a range of bytes, the end, two columns), navigates it, and compares with the
truth. *Silently wrong*: a result without a warning, with more than a tenth of its epochs outside 3 sd. ``--count 0 --log
LOG --report reports/mutations.md`` makes the page of all that the log holds.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import resource
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d

import insnav
from insnav.exceptions import InsnavError
from insnav.findings import Severity
from insnav.session.read import read
from insnav.steps import Recording
from insnav.steps.inputs import Inputs
from tests.input import test_folders, test_ros_bag, test_rtklib_pos
from tests.input import written_logs as logs
from tests.input.files import GPS_HEADER, IMU_HEADER, as_text
from tests.input.recordings import TOW, Motion
from tests.input.test_matlab import version_5
from tests.input.test_nmea_ubx import UTC, nmea, ubx

FIRST, LENGTH = 70.0, 60.0  # part of the drive [s]
FIXES = (("lla", 3e-9), ("v_n", 0.05))  # 2 cm
SD = 0.005  # of the fixes [m], and twice that of their velocities [m/s]: better than any writer states
Files = dict[str, bytes]


@dataclass(frozen=True)
class Recorded(Motion):
    """A part of a simulated drive instead of the closed form."""

    lla: np.ndarray = None
    v_n: np.ndarray = None
    gyro: np.ndarray = None
    accel: np.ndarray = None

    @property
    def heading(self) -> np.ndarray:
        return np.degrees(np.arctan2(self.v_n[:, 1], self.v_n[:, 0])) % 360.0


@dataclass(frozen=True)
class Truth:
    """Exact motion at times after the start of the part."""

    time: np.ndarray
    lla: np.ndarray  # [deg], [deg], [m]
    v_n: np.ndarray
    heading: np.ndarray  # [deg]


def drive() -> tuple[Recorded, Recorded, Truth]:
    """Return samples, fixes and truth of a simulated car with turns."""
    made = insnav.simulate("bends", imu="industrial", gps="dgps", seed=11)
    imu, gps, ref = made.imu.data, made.gps.data, made.reference.data
    parts = [np.flatnonzero((each.time > FIRST) & (each.time < FIRST + LENGTH)) for each in (imu, gps)]
    degrees = [180.0 / np.pi, 180.0 / np.pi, 1.0]
    truth = Truth(ref.time - FIRST, ref.lla * degrees, ref.v_n, np.degrees(ref.rph[:, 2]))
    samples = Recorded(imu.time[parts[0]] - FIRST, None, None, imu.gyro[parts[0]], imu.accel[parts[0]])
    at, random_ = gps.time[parts[1]] - FIRST, np.random.default_rng(1)
    lla, v_n = (
        np.column_stack([np.interp(at, truth.time, each) for each in rows.T]) for rows in (truth.lla, truth.v_n)
    )
    lla += random_.normal(size=lla.shape) * [SD / 111e3, SD / 55e3, SD]
    return samples, Recorded(at, lla, v_n + random_.normal(scale=2.0 * SD, size=v_n.shape)), truth


def written(samples: Recorded, fixes: Recorded) -> dict[str, Files]:
    """Return the files of the drive in each format: one with both, or ``imu`` and ``gps``."""
    imu = np.column_stack([TOW + samples.t, samples.gyro, samples.accel])
    sd = np.tile([0.5, 0.5, 1.0], (len(fixes.t), 1))
    gps = np.column_stack([TOW + fixes.t, fixes.lla, fixes.v_n, sd])
    step = float(np.median(np.diff(samples.t)))
    rfu = [1.0, 1.0, -1.0]
    inc = np.column_stack([samples.gyro[:, [1, 0, 2]] * rfu, samples.accel[:, [1, 0, 2]] * rfu]) * step
    enu, rad = fixes.v_n[:, [1, 0, 2]] * rfu, fixes.lla * [np.pi / 180, np.pi / 180, 1.0]
    table = as_text(imu, IMU_HEADER).encode()
    psins = {"imu": np.column_stack([inc, TOW + samples.t]), "gps": np.column_stack([enu, rad, TOW + fixes.t])}
    kf = np.column_stack([TOW + samples.t, samples.gyro * step, samples.accel * step])
    test_rtklib_pos.motion, test_rtklib_pos.TOW = lambda: (fixes.lla, fixes.v_n), TOW + fixes.t
    test_ros_bag.SAMPLES, test_ros_bag.FIXES = samples, fixes
    bags = {}
    with tempfile.TemporaryDirectory() as folder:
        for kind in ("ros1", "mcap"):
            test_ros_bag.write_bag(Path(folder) / kind, kind=kind)
            path = next(each for each in [Path(folder) / kind, *Path(folder).glob(f"{kind}/*.mcap")] if each.is_file())
            bags[f"ROS {kind}"] = {f"log.{'bag' if kind == 'ros1' else 'mcap'}": path.read_bytes()}
    return {
        "CSV": {"imu.csv": table, "gps.csv": as_text(gps, GPS_HEADER).encode()},
        "CSV, decimal commas": {
            "imu.csv": as_text(imu, IMU_HEADER, delimiter=";", decimal=",").encode(),
            "gps.csv": as_text(gps, GPS_HEADER, delimiter=";", decimal=",").encode(),
        },
        "NMEA": {"imu.csv": table, "gps.nmea": nmea(fixes, UTC)},
        "UBX": {"log.ubx": ubx(fixes, samples=samples)},
        "ULog": {"log.ulg": logs.ulog(samples, fixes)},
        "ArduPilot": {"log.bin": logs.dataflash(samples, fixes)},
        "NovAtel": {"log.gps": logs.novatel(samples, fixes)},
        "SBF": {"log.sbf": logs.sbf(samples, fixes)},
        "RTKLIB": {"imu.csv": table, "gps.pos": test_rtklib_pos.solution("llh").encode()},
        "VBOX": {"imu.csv": table, "gps.vbo": logs.vbox(fixes)},
        "KF-GINS": {"imu.txt": _blanks(kf), "gps.txt": _blanks(gps[:, [0, 1, 2, 3, 7, 8, 9]])},
        "PSINS": {key + ".txt": _blanks(value) for key, value in psins.items()},
        "MATLAB": {"log.mat": version_5(psins)},
        "JSON": {"log.jsonl": logs.openpilot(samples, fixes)},
        "phyphox": {"log.zip": test_folders.as_zip(test_folders.phyphox(samples, fixes))},
        "GnssLogger": {"log.txt": logs.gnss_logger(samples, fixes)},
        **bags,
    }


def _blanks(rows: np.ndarray) -> bytes:
    return "".join(" ".join(f"{x:.12e}" for x in row) + "\n" for row in rows).encode()


def mutated(files: Files, rng: random.Random) -> tuple[Files, str]:
    """Change one file at random: return all files, and what was done."""
    name = rng.choice([*files])
    data, how = files[name], rng.choice(["digit", "bytes", "cut", "columns"])
    text = name.endswith((".csv", ".txt", ".pos", ".vbo", ".nmea", ".jsonl"))
    at = rng.randrange(len(data))
    if how == "columns" and text and not name.endswith(".jsonl"):
        delimiter = next((each for each in b";," if each in data[:200]), ord(" "))
        cell = b"[^" + bytes([delimiter]) + rb"\n]+"
        lines = data.split(b"\n")
        count = len(re.findall(cell, lines[-2]))
        i, j = sorted(rng.sample(range(count), 2)) if count > 1 else (0, 0)
        header = rng.random() < 0.5  # half of the time, the names stay where they are
        swapped = [_swap(line, cell, i, j) if k or header else line for k, line in enumerate(lines)]
        return {**files, name: b"\n".join(swapped)}, f"{name}: columns {i}, {j}"
    if how == "bytes":
        size = rng.choice([1, 3, 20, 400])
        return {**files, name: data[:at] + data[at + size :]}, f"{name}: {size} bytes at {at} deleted"
    if how == "cut":
        return {**files, name: data[: max(at, 1)]}, f"{name}: cut at {at}"
    if text:
        places = [found.start() for found in re.finditer(rb"\d", data[at : at + 4000])] or [0]
        at += rng.choice(places)
        change = str(rng.randrange(10)).encode()
    else:
        change = bytes([data[at] ^ (1 << rng.randrange(8))])
    return {
        **files,
        name: data[:at] + change + data[at + 1 :],
    }, f"{name}: byte {at} {data[at : at + 1]!r} -> {change!r}"


def _swap(line: bytes, cell: bytes, i: int, j: int) -> bytes:
    spans = [found.span() for found in re.finditer(cell, line)]
    if j >= len(spans) or i == j:
        return line
    (a, b), (c, d) = spans[i], spans[j]
    return line[:a] + line[c:d] + line[b:c] + line[a:b] + line[d:]


def saved(files: Files, folder: Path) -> list[Path | None]:
    """Write the files of a drive; return those of the IMU and of the fixes."""
    for name, data in files.items():
        (folder / name).write_bytes(data)
    return [*(folder / name for name in files), None][:2]


def alike(read: Recording, clean: Recording) -> bool:
    """Return whether a reading has the samples and fixes of another, but for a few rows and their noise."""
    if read.gps is None or clean.gps is None:
        return False
    pairs = ((read.imu.data, clean.imu.data, ("gyro", 0.01), ("accel", 0.1)), (read.gps.data, clean.gps.data, *FIXES))
    for mine, other, *columns in pairs:
        at = np.searchsorted(other.time, mine.time - 1e-6)
        if len(mine.time) < 0.99 * len(other.time) or at[-1] >= len(other.time):
            return False
        if np.abs(other.time[at] - mine.time).max() > 1e-3:
            return False
        for name, limit in columns:
            if not np.nanmax(np.abs(getattr(mine, name) - getattr(other, name)[at]), initial=0.0) < limit:
                return False
    return True


def outside(result: Any, truth: Truth, start: float, height: float) -> float:
    """Return the share of the epochs with an error of more than 3 sd. `start`, `height`: of the clock and the datum."""
    table = result.to_frame()
    time = table["time_s"].to_numpy() - start
    inside = (time >= truth.time[0]) & (time <= truth.time[-1])
    if not inside.any():
        return 1.0

    def at(values: np.ndarray) -> np.ndarray:
        return np.interp(time, truth.time, values)

    lla = [at(column) for column in truth.lla.T]
    east, north, up = pymap3d.geodetic2enu(
        *(table[key].to_numpy() for key in ("lat_deg", "lon_deg")), table["height_m"].to_numpy() - height, *lla
    )
    errors = {"sd_n_m": north, "sd_e_m": east, "sd_d_m": up}
    for axis, column in zip("ned", truth.v_n.T, strict=True):
        errors[f"sd_v{axis}_m_s"] = table[f"v{axis}_m_s"].to_numpy() - at(column)
    heading = at(np.unwrap(truth.heading, period=360.0))
    errors["sd_heading_deg"] = (table["heading_deg"].to_numpy() - heading + 180.0) % 360.0 - 180.0
    far = [np.abs(error) > 3.0 * table[sd].to_numpy() for sd, error in errors.items()]
    return float(max(np.mean(each[inside]) for each in far)) if inside.mean() > 0.9 else 1.0


def outcomes(files: Files, truth: Truth, first: float, count: int, rng: random.Random) -> Iterator[tuple[str, str]]:
    """Yield outcome and description of each mutation of a format. `first`: time of the first sample."""
    with tempfile.TemporaryDirectory() as folder:
        paths = saved(files, Path(folder))
        read_clean, clean = read(*paths, None, Inputs()), insnav.load(*paths, imu="industrial").navigate()
        start = float(np.round(clean.inputs["imu"].start_s - first, 3))
        inside = (truth.time > 0.0) & (truth.time < LENGTH)
        height = float(np.round(np.median(clean.to_frame()["height_m"]) - np.median(truth.lla[inside, 2])))
        yield "clean", f"{outside(clean, truth, start, height):.2f} outside, {[f.code for f in _warnings(clean)]}"
        for _ in range(count):
            changed, how = mutated(files, rng)
            yield _outcome(changed, Path(folder), read_clean, lambda r: outside(r, truth, start, height), how)


def _warnings(result: Any) -> list[Any]:
    return [each for each in result.findings if each.severity >= Severity.WARNING]


def _outcome(files: Files, folder: Path, clean: Recording, misses: Callable[[Any], float], how: str) -> tuple[str, str]:
    try:
        paths = saved(files, folder)
        if alike(read(*paths, None, Inputs()), clean):
            return "right", f"{how}: not navigated"
        result = insnav.load(*paths, imu="industrial").navigate()
        share = misses(result)
    except InsnavError as error:
        return "refused", f"{how}: {error.code}"
    except Exception:
        return "DEFECT", f"{how}: {traceback.format_exc(limit=-3)}"
    warned = _warnings(result)
    if warned:
        return "warned", f"{how}: {share:.2f} {warned[0].code}"
    return ("SILENT" if share > 0.1 else "right"), f"{how}: {share:.2f}"


def page(log: Path) -> str:
    """Return the outcomes in a log as a page: formats by rows."""
    counts: dict[str, Counter[str]] = {}
    peak = 0.0
    for name, outcome, how in map(json.loads, log.read_text(encoding="utf-8").splitlines()):
        if outcome == "peak":
            peak = max(peak, how)
        elif outcome != "clean":
            counts.setdefault(name, Counter())[outcome] += 1
    kinds = {"right": "right", "warned": "warned", "refused": "refused", "SILENT": "silently wrong", "DEFECT": "defect"}
    counts["all"] = sum(counts.values(), Counter())
    lines = [
        f"| {name} | {own.total()} | " + " | ".join(str(own[kind]) for kind in kinds) + " |"
        for name, own in counts.items()
    ]
    share = 100.0 * counts["all"]["SILENT"] / counts["all"].total()
    return PAGE.format(
        version=insnav.__version__,
        names=" | ".join(kinds.values()),
        lines="\n".join(lines),
        share=share,
        peak=peak / 1e3,
    )


PAGE = """# Mutated files

Version {version}; made by `python -m tests.input.mutations`, which explains the words.

| format | files | {names} |
| --- | ---: | ---: | ---: | ---: | ---: | ---: |
{lines}

Silently wrong: {share:.2f} %. Largest memory of a process: {peak:.2f} GB.
"""


def main() -> None:
    """Print a table of outcomes by format, and every silent or defective one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("formats", nargs="*")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--log", type=Path)
    parser.add_argument("--report", type=Path)
    given = parser.parse_args()
    if given.report and not given.count:
        given.report.write_text(page(given.log), encoding="utf-8")
        return
    samples, fixes, truth = drive()
    total: Counter[str] = Counter()
    for name, files in written(samples, fixes).items():
        if given.formats and name not in given.formats:
            continue
        counts: Counter[str] = Counter()
        rng = random.Random(f"{name} {given.seed}")
        for outcome, how in outcomes(files, truth, samples.t[0], given.count, rng):
            counts[outcome] += outcome != "clean"
            if outcome in ("clean", "SILENT", "DEFECT"):
                print(f"{name}: {outcome}: {how}", flush=True)
            if given.log:
                with given.log.open("a") as log:
                    log.write(json.dumps([name, outcome, how]) + "\n")
        if given.log:
            with given.log.open("a") as log:
                log.write(json.dumps([name, "peak", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3]) + "\n")
        total += counts
        print(f"{name}: {dict(counts)}", flush=True)
    print(f"all: {dict(total)}")


if __name__ == "__main__":
    main()
