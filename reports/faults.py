"""Measure the tables of docs/accuracy/faults.md: ``python reports/faults.py``."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

import insnav
from insnav.earth import lla_offset
from insnav.exceptions import InsnavError
from insnav.findings import Severity
from insnav.library import sample_drive
from insnav.messages import phrase
from insnav.report.save import page_of
from insnav.types import GpsData

PAGE = Path(__file__).parents[1] / "docs" / "accuracy" / "faults.md"
SEEDS = range(1, 5)
SAMPLE_BEGIN = 200.0  # of edits that do not concern the whole sample drive, after its first fix [s]
SIMULATED = {
    "none": "",
    "one fix wrong by 60 m": "gps-spike:60m@120s",
    "wrong by 60 m for 8 s": "gps-jump:60m@120s+8s",
    "wrong by 100 m for 30 s": "gps-jump:100m@120s+30s",
    "four of five fixes wrong by 50 m for 60 s": "gps-flap:50m@120s+60s",
    "wrong by 20 m from then on": "gps-jump:20m@120s",
    "60 s of drift at 1 m/s, then wrong by 60 m from then on": "gps-drag:1m/s@120s+60s",
    "no fixes for 30 s": "gps-outage@120s+30s",
    "fixes 0.3 s late throughout": "gps-latency:0.3s",
    "fixes 0.3 s late from 150 s on": "gps-latency:0.3s@150s",
    "reported sd 0.3 times the true one": "gps-sd:0.3",
    "samples missing for 0.5 s": "imu-gap@120s+0.5s",
    "samples missing for 10 s": "imu-gap@120s+10s",
    "z gyro stuck for 2 s": "imu-stuck:gyro-z@120s+2s",
    "one sample 3 rad/s off": "imu-spike:3rad/s@120s",
    "axes forward, left, up": "imu-axes:FLU",
    "gyros in deg/s": "imu-units:deg/s",
}


def navigate(imu: Any, gps: Any, ref: Any) -> tuple[dict[str, float], set[str], str]:
    """Return the figures of the smoothed solution, the codes of its warnings, and its rating."""
    result = insnav.load(imu, gps=gps, ref=ref).navigate()
    codes = {each.code.value for each in result.findings if each.severity >= Severity.WARNING}
    verdict = page_of(result).verdict
    assert verdict is not None
    return result.accuracy["smoothed"], codes, phrase(f"light.{verdict.light}")


def of_simulated() -> list[str]:
    """Return the rows of the simulated drives."""
    rows = []
    for name, fault in SIMULATED.items():
        title = f"{name}: `{fault}`" if fault else name
        try:
            drives = [
                insnav.simulate("city", imu="automotive", seed=seed, faults=(fault,) if fault else ()) for seed in SEEDS
            ]
            found = [navigate(each.imu.data, each.gps.data, each.reference.data) for each in drives]
        except InsnavError as error:
            rows.append(f"| {title} | – | – | – | refused with exit code {error.exit_code} |")
            continue
        rms, sd = (
            np.sqrt(np.mean([each[0][key] ** 2 for each in found])) for key in ("horizontal_m", "horizontal_sd_m")
        )
        inside = min(each[0]["inside_3_sd_percent"] for each in found)
        codes = ", ".join(f"`{code}`" for code in sorted(set.union(*(each[1] for each in found)))) or "none"
        rows.append(f"| {title} | {rms:.3g} | {sd:.3g} | {inside:.3g} | {codes} |")
    return rows


def of_sample() -> list[str]:
    """Return the rows of the sample drive with edited fixes."""
    imu, fixes, ref = sample_drive()
    gps = insnav.load(imu, gps=fixes, ref=ref).gps.data
    time, number = gps.time - gps.time[0], np.arange(gps.time.size)
    inside = (time >= SAMPLE_BEGIN) & (time < SAMPLE_BEGIN + 100.0)

    def repeated(rows: np.ndarray, velocity: bool) -> GpsData:
        before = np.where(rows, number - 1, number)
        return replace(gps, lla=gps.lla[before], v_n=gps.v_n[before] if velocity else gps.v_n)

    def velocities(rows: np.ndarray, value: np.ndarray, axes: Sequence[int] = (0, 1, 2)) -> GpsData:
        changed = gps.v_n.copy()
        changed[np.ix_(rows, axes)] = value
        return replace(gps, v_n=changed)

    off = np.outer((time >= SAMPLE_BEGIN) & (time < SAMPLE_BEGIN + 59.0), [25.0, 0.0, 0.0])
    every, none = np.ones_like(inside), np.zeros(3)
    edits: dict[str, Callable[[], GpsData]] = {
        "every second fix repeats the fix before, velocity too": lambda: repeated(number % 2 == 1, True),
        "every third position repeats the position before": lambda: repeated(number % 3 == 2, False),
        "all velocities zero": lambda: velocities(every, none),
        "every second velocity zero": lambda: velocities(number % 2 == 1, none),
        "velocities zero in the second half": lambda: velocities(time > 0.5 * time[-1], none),
        "one velocity held for 100 s": lambda: velocities(inside, gps.v_n[inside][0]),
        "all vertical velocities zero": lambda: velocities(every, none[:1], (2,)),
        "latitudes wrong by 25 m for 59 s": lambda: replace(gps, lla=lla_offset(gps.lla, off)),
    }
    rows = []
    for name, edit in {"none": lambda: gps, **edits}.items():
        found, _, rating = navigate(imu, edit(), ref)
        figures = (f"{found[key]:.2f}" for key in ("horizontal_m", "horizontal_sd_m", "vertical_m"))
        rows.append(f"| {name} | {' | '.join(figures)} | {rating} |")
    return rows


def write() -> None:
    """Replace the rows below the heads of both tables, and the date and commit of the measurement."""
    text = PAGE.read_text(encoding="utf-8")
    commit = subprocess.run(["git", "rev-parse", "--short=8", "HEAD"], capture_output=True, text=True, check=True)
    measured = f"Measured on {datetime.now(UTC):%Y-%m-%d} (commit `{commit.stdout.strip()}`)"
    text = re.sub(r"Measured on\s[\d-]+ \(commit `\w+`\)", measured, text)
    tables = iter((of_simulated(), of_sample()))
    text = re.sub(r"(?m)(^\|[-:|]+\|\n)(?:^\|.*\n)+", lambda match: match[1] + "\n".join(next(tables)) + "\n", text)
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write()
