"""Compare two versions of insnav cell by cell: every fault in every drive, one row of a table each.

``python tests/faults/shadow.py --out NEW.csv [--drives city,tunnel] [--faults REGEX] [--seeds 0,1]``
    Navigate drives of the fault matrix (`tests.faults.injection`) with each of its faults. Seed 0 is the matrix's own.
``python tests/faults/shadow.py --out NEW.csv --prototype DIR``
    Navigate folders ``DIR/<fault>-<variant>`` with ``imu.csv``, ``gps.csv`` and ``ref.csv``, without configuration.
``python tests/faults/shadow.py --out NEW.csv --recorded``
    Navigate the recorded drives beside the project as they are.
``python tests/faults/shadow.py --compare OLD.csv NEW.csv``
    Print the cells that got worse or better, and totals.

``PYTHONPATH`` chooses the version under test. A table that exists is continued: its rows are not computed again.
Outcomes are those of `tests.faults.injection`. One process and one thread are used, so CPU times can be compared.

Columns: ``rms_m``, ``max_m``, ``nees`` are horizontal; ``nees`` is the mean of error² / variance of a coordinate, so 1
is ideal. ``in_*`` are shares of the smoothed solution inside 3 sd [%]: ``in_position`` and ``in_velocity`` of all
coordinates, ``in_horizontal`` of epochs with both horizontal coordinates inside. ``filters`` counts runs of the
filter: calls of `Navigator.finish` and `Navigator.history`. ``warnings`` are codes of warnings and worse.
"""

from __future__ import annotations

import argparse
import csv
import os
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache, partial, wraps
from pathlib import Path
from typing import Any

import numpy as np

import insnav
from insnav.errors.evaluated_run import fixed_epochs
from insnav.errors.metrics import position_errors
from insnav.exceptions import InsnavError
from insnav.filter import navigator
from insnav.findings import Severity
from insnav.input import read_reference
from insnav.library import sample_drive
from insnav.session.drive import Drive
from insnav.types import Trajectory
from tests.faults import injection
from tests.faults.injection import Case, Clean, Data
from tests.shared import DATA

KEY = ("drive", "seed", "fault")
SHARES = ("in_position", "in_horizontal", "in_velocity", "in_heading")
SCORES = ("rms_m", "max_m", "nees", "heading_rms_deg", *SHARES)
COLUMNS = (*KEY, "outcome", *SCORES, "filters", "cpu_s", "warnings", "words")
STRIDE = 7  # every seventh fault first, so that an unfinished table has all families
THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
# worst first; `refused` and `warned` leave the user warned, `told` and `good` hold what they state
RANKS = {"crash": 0, "silent": 1, "events": 2, "stated": 3, "note": 4, "warned": 5, "refused": 5, "told": 6, "good": 6}
RMS_RATIO, INSIDE_POINTS = 1.1, 5.0  # changes that count as worse or better [-], [%]
NONE = Case("none", "", lambda data: (data.imu, data.gps))


@dataclass(frozen=True)
class Files:
    """A drive in files, which insnav reads without configuration."""

    imu: Path
    gps: Path | None
    ref: Path | None = None

    def navigate(self) -> Any:
        """Navigate as a user would."""
        return insnav.load(self.imu, gps=self.gps, ref=self.ref).navigate()


@dataclass(frozen=True)
class Cell:
    """One drive with one fault."""

    drive: str
    seed: int
    case: Case
    truth: Callable[[], Trajectory] | None = None  # by default that of the drive

    @property
    def name(self) -> str:
        """Name of the drive in `injection.DRIVES`."""
        return f"{self.drive}/{self.seed}"

    @property
    def key(self) -> tuple[str, str, str]:
        """Values of the key columns."""
        return self.drive, str(self.seed), f"{self.case.row} {self.case.name}".strip()


class Meter:
    """Count CPU time and runs of the filter, and keep the result of the newest drive."""

    def __init__(self) -> None:
        self.reset()
        for owner, name in ((insnav, "load"), (Drive, "navigate")):
            setattr(owner, name, self._timed(getattr(owner, name)))
        for name in ("finish", "history"):
            setattr(navigator.Navigator, name, self._counted(getattr(navigator.Navigator, name)))

    def reset(self) -> None:
        """Begin a drive."""
        self.seconds, self.filters = 0.0, 0
        self.result: Any = None

    def _timed(self, function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def call(*given: Any, **options: Any) -> Any:
            begin = time.process_time()
            try:
                self.result = function(*given, **options)
            finally:
                self.seconds += time.process_time() - begin
            return self.result

        return call

    def _counted(self, function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def call(*given: Any, **options: Any) -> Any:
            self.filters += 1
            return function(*given, **options)

        return call


# --- cells -------------------------------------------------------------------------------------------------


def matrix_cells(drives: Iterable[str], seeds: Iterable[int]) -> Iterator[Cell]:
    """Give the cells of the fault matrix, every seventh fault first."""
    known = {"tunnel": lambda: injection._simulated("tunnel", "automotive", "single", 16, (0.0, 300.0))}
    known = known | dict(injection.DRIVES)
    pairs, faults = [(name, seed) for name in drives for seed in seeds], [NONE, *injection.cases()]
    for name, seed in pairs:
        injection.DRIVES[f"{name}/{seed}"] = partial(with_seed, known[name], seed)
    for first in range(STRIDE):
        for name, seed in pairs:
            yield from (Cell(name, seed, case) for case in faults[first::STRIDE])


def with_seed(make: Callable[[], Data], more: int) -> Data:
    """Make a drive of the matrix with another seed, by so much higher."""
    own = injection._simulated
    injection._simulated = lambda profile, imu, gps, seed, *rest: own(profile, imu, gps, seed + more, *rest)
    try:
        return make()
    finally:
        injection._simulated = own


def folder_cells(folder: Path, drives: Iterable[str]) -> Iterator[Cell]:
    """Give the cells of drives in folders ``<fault>-<variant>``."""
    found = [path.parent for path in sorted(folder.glob("*-*/imu.csv")) if not path.parent.name.startswith("base-")]
    variants = sorted({path.name.rpartition("-")[2] for path in found})
    for variant in [each for each in variants if not drives or each in drives]:
        clean = folder / f"none-{variant}"
        injection.DRIVES[f"{variant}/0"] = partial(data_in, clean)
    for path in sorted(found, key=lambda path: not path.name.startswith("none-")):
        fault, _, variant = path.name.rpartition("-")
        if f"{variant}/0" in injection.DRIVES:
            yield Cell(variant, 0, Case(fault, "", partial(files_in, path)), partial(truth_in, path))


def files_in(folder: Path, _: Data | None = None) -> tuple[Any, Any]:
    """Give the files in a folder, in the place of samples and fixes."""
    return Files(folder / "imu.csv", folder / "gps.csv"), None


def data_in(folder: Path) -> Data:
    """Give the drive in a folder with its exact motion."""
    return Data(*files_in(folder), truth_in(folder))


def truth_in(folder: Path) -> Trajectory:
    """Read the exact motion in a folder."""
    return read_reference(folder / "ref.csv").data


def recorded_cells(drives: Iterable[str]) -> Iterator[Cell]:
    """Give the recorded drives that are present, each with the best reference it has."""
    tokyo, rtk, uav, fog, rest = (
        DATA / name
        for name in (
            "ixr_tsukishima_20210412",
            "rtklib_drive_20250708",
            "umn_thor75_uav",
            "psins_fog_mems_100s",
            "psins_rlg_static",
        )
    )
    imu, gps, ref = (Path(path) for path in sample_drive())
    known: dict[str, tuple[Files | None, Path]] = {
        "sample": (Files(imu, gps), ref),
        "rtklib": (Files(rtk / "imu.csv.gz", rtk / "gps.csv"), rtk / "gps.csv"),  # its own fixes, good to centimetres
        "ixr": (Files(tokyo / "imu.csv.gz", tokyo / "gps.csv"), tokyo / "ref.csv"),
        "umn": (Files(uav / "imu.csv.gz", uav / "gps.csv"), uav / "onboard_nav" / "ref.csv"),  # not better, only other
        "psins_fog": (None, fog / "ref.csv"),  # fixes are made from the reference
        "psins_rlg": (Files(rest / "imu.csv.gz", None, rest / "ref.csv"), rest / "ref.csv"),
    }
    for name, (files, reference) in known.items():
        if reference.is_file() and (not drives or name in drives):
            injection.DRIVES[f"{name}/0"] = partial(recorded_data, files, reference)
            yield Cell(name, 0, NONE)


def recorded_data(files: Any, reference: Path) -> Data:
    """Give the `Files` of a recorded drive and its reference, where ambiguities are fixed."""
    truth = fixed_epochs(read_reference(reference))[0]
    if not np.ptp(truth.lla, axis=0).any():  # at rest, also between its few rows
        at = np.arange(*truth.time[[0, -1]], dtype=np.float64)
        truth = replace(truth.rows(np.zeros(at.size, dtype=np.int64)), time=at)
    if files is None:
        return replace(injection.DRIVES["fog"](), truth=truth)
    return Data(files, files, truth)


def without_comparison(name: str) -> Clean:
    """Stand for the run without a fault, where every warning counts."""
    truth = injection.drive(name).truth
    assert truth is not None
    return Clean(2.0, ({}, {}, {}), truth, 0.0)


# --- rows --------------------------------------------------------------------------------------------------


def measured(cell: Cell, meter: Meter) -> dict[str, str]:
    """Navigate a cell and give its row."""
    row = dict.fromkeys(COLUMNS, "") | dict(zip(KEY, cell.key, strict=True))
    try:
        truth = injection.clean(cell.name).truth if cell.truth is None else cell.truth()
        injection.clean(cell.name)
        meter.reset()
        found = injection.outcome(cell.name, cell.case)
    except InsnavError as error:
        return row | {"outcome": "refused", "words": f"without a fault: {error.exit_code} {error.what}"}
    except Exception as error:
        return row | {"outcome": "crash", "words": f"without a fault: {type(error).__name__} {error}"}
    row |= {"outcome": found.kind, "filters": str(meter.filters), "cpu_s": f"{meter.seconds:.2f}"}
    row["words"] = " ".join(found.words.split())[:300]
    if (run := getattr(getattr(meter.result, "found", None), "run", None)) is not None:
        codes = {each.code.value for each in meter.result.findings if each.severity >= Severity.WARNING}
        row["warnings"] = " ".join(sorted(codes))
        with suppress(InsnavError):  # no time in common with the truth
            numbers = scores(run.smoothed.solution, truth, cell.case.shift)
            row |= {name: f"{value:.4g}" for name, value in numbers.items()}
    return row


def scores(track: Trajectory, truth: Trajectory, shift: float) -> dict[str, float]:
    """Compare a solution with the exact motion."""
    off = position_errors(replace(track, time=track.time - shift), truth)
    assert off.sd is not None
    errors, sd = np.hstack([off.position, off.velocity, off.attitude]), off.sd[:, :9]
    if truth.sd is not None:
        known = truth.sd[:, : sd.shape[1]]
        at = [np.interp(off.time, truth.time, np.nan_to_num(column)) for column in known.T]
        sd = np.hypot(sd, np.pad(np.column_stack(at), ((0, 0), (0, sd.shape[1] - known.shape[1]))))
    inside, known = np.abs(errors) <= 3.0 * sd, np.isfinite(errors)

    def share(columns: slice) -> float:
        return 100.0 * float(inside[:, columns][known[:, columns]].mean()) if known[:, columns].any() else np.nan

    heading = np.rad2deg(errors[known[:, 8], 8])
    return {
        "rms_m": float(np.sqrt(np.mean(off.horizontal**2))),
        "max_m": float(off.horizontal.max()),
        "nees": float(np.mean((errors[:, :2] / sd[:, :2]) ** 2)),
        "heading_rms_deg": float(np.sqrt(np.mean(heading**2))) if heading.size else np.nan,
        "in_position": share(slice(0, 3)),
        "in_horizontal": 100.0 * float(inside[:, :2].all(axis=1).mean()),
        "in_velocity": share(slice(3, 6)),
        "in_heading": share(slice(8, 9)),
    }


def read_rows(table: Path) -> dict[tuple[str, ...], dict[str, str]]:
    """Read a table by its key."""
    with table.open(newline="", encoding="utf-8") as file:
        return {tuple(row[name] for name in KEY): row for row in csv.DictReader(file)}


def continue_table(table: Path, cells: Iterable[Cell], faults: str) -> None:
    """Compute the rows that a table lacks, and print each."""
    known = injection.navigated
    injection.navigated = lambda imu, *rest: imu.navigate() if isinstance(imu, Files) else known(imu, *rest)
    injection.drive, injection.clean = (  # every drive stays in memory: the order goes from one to the next
        lru_cache(maxsize=None)(getattr(each, "__wrapped__", each)) for each in (injection.drive, injection.clean)
    )
    done = read_rows(table) if table.exists() else {}
    meter = Meter()
    with table.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        if not done and file.tell() == 0:
            writer.writeheader()
        for cell in cells:
            if cell.key in done or not re.search(faults, cell.key[2]):
                continue
            row = measured(cell, meter)
            writer.writerow(row)
            file.flush()
            print("  ".join(row[name] for name in COLUMNS[:-1]), flush=True)


# --- comparison --------------------------------------------------------------------------------------------


def compare(old: Path, new: Path) -> None:
    """Print how a table differs from another."""
    before, after = read_rows(old), read_rows(new)
    common = [key for key in before if key in after]
    changes = {key: differences(before[key], after[key]) for key in common}
    for word, sign in (("worse", -1), ("better", 1)):
        listed = [(key, [text for each, text in changes[key] if each == sign]) for key in common]
        listed = [(key, texts) for key, texts in listed if texts]
        print(f"{len(listed)} of {len(common)} cells got {word}")
        for key, texts in listed:
            codes = [set(rows[key]["warnings"].split()) for rows in (before, after)]
            signs = [*(f"+{code}" for code in codes[1] - codes[0]), *(f"-{code}" for code in codes[0] - codes[1])]
            print(f"  {key[0]:<10} {key[1]:<3} {key[2]:<32} {'; '.join(texts)}  {' '.join(sorted(signs))}")
    counts = [Counter(rows[key]["outcome"] for key in common) for rows in (before, after)]
    print(f"\n{'':<10}" + "".join(f"{kind:>9}" for kind in injection.OUTCOMES))
    for word, each in zip(("old", "new"), counts, strict=True):
        print(f"{word:<10}" + "".join(f"{each[kind]:>9}" for kind in injection.OUTCOMES))
    for name in (*SCORES, "filters", "cpu_s"):
        pairs = np.array([[number(rows[key][name]) for rows in (before, after)] for key in common]).reshape(-1, 2)
        pairs = pairs[np.isfinite(pairs).all(axis=1)]
        if pairs.size:
            print(f"median {name:<16} old {np.median(pairs[:, 0]):9.4g}  new {np.median(pairs[:, 1]):9.4g}", end="")
            ratio = pairs[pairs[:, 0] > 0.0, 1] / pairs[pairs[:, 0] > 0.0, 0]
            print(f"  ratio: median {np.median(ratio):.3g}, largest {ratio.max():.3g}" if ratio.size else "")
    total = [sum(number(rows[key]["cpu_s"]) for key in common if rows[key]["cpu_s"]) for rows in (before, after)]
    print(f"CPU time of all: old {total[0]:.0f} s, new {total[1]:.0f} s")
    print(f"{len(before) - len(common)} cells only in {old}, {len(after) - len(common)} only in {new}")


def differences(old: dict[str, str], new: dict[str, str]) -> list[tuple[int, str]]:
    """Say what became worse (-1) or better (1) in a cell."""
    found = []
    if step := RANKS[new["outcome"]] - RANKS[old["outcome"]]:
        found.append((int(np.sign(step)), f"{old['outcome']} -> {new['outcome']}"))
    ratio = number(new["rms_m"]) / max(number(old["rms_m"]), 1e-12)
    if ratio > RMS_RATIO or ratio < 1.0 / RMS_RATIO:
        found.append((-1 if ratio > 1.0 else 1, f"RMS {old['rms_m']} -> {new['rms_m']} m"))
    for name in SHARES:
        change = number(new[name]) - number(old[name])
        if abs(change) > INSIDE_POINTS:
            found.append((int(np.sign(change)), f"{name} {old[name]} -> {new[name]} %"))
    return found


def number(text: str) -> float:
    """Read a number; ``NaN`` where there is none."""
    return float(text) if text else np.nan


def main() -> None:
    """Continue a table, or compare two."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="table to continue")
    parser.add_argument("--drives", default="", help="names, comma between; all by default")
    parser.add_argument("--faults", default="", help="regular expression: only these")
    parser.add_argument("--seeds", default="0", help="numbers, comma between: added to the drive's own")
    parser.add_argument("--prototype", type=Path, metavar="DIR", help="folders <fault>-<variant>")
    parser.add_argument("--recorded", action="store_true", help="recorded drives")
    parser.add_argument("--compare", type=Path, nargs=2, metavar="CSV")
    given = parser.parse_args()
    if given.compare:
        compare(*given.compare)
        return
    if given.out is None:
        parser.error("--out or --compare is needed")
    if any(os.environ.get(name) != "1" for name in THREADS):  # libraries read these when they are imported
        os.execve(sys.executable, sys.orig_argv, os.environ | dict.fromkeys(THREADS, "1"))
    drives = [name for name in given.drives.split(",") if name]
    if given.recorded:
        injection.clean = without_comparison  # type: ignore[assignment]
        cells = recorded_cells(drives)
    elif given.prototype:
        cells = folder_cells(given.prototype, drives)
    else:
        cells = matrix_cells(drives or [*injection.DRIVES], [int(seed) for seed in given.seeds.split(",")])
    continue_table(given.out, cells, given.faults)


if __name__ == "__main__":
    main()
