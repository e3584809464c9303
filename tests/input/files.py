"""Recordings made up from closed forms, and ways to write them badly."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from insnav.findings import Code, Finding, of_code
from insnav.input import Reading

SHARED = Path(__file__).parents[2].parent / "shared"
G = 9.8

IMU_HEADER = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
GPS_HEADER = "time_s,lat_deg,lon_deg,height_m,vn_m_s,ve_m_s,vd_m_s,sd_n_m,sd_e_m,sd_d_m"


def rolling(n: int = 3000, rate: float = 100.0, start: float = 100.0) -> np.ndarray:
    """Body that rolls to and fro without moving: time, rates, specific force in Forward, Right, Down; (n, 7).

    For the roll angle r, gravity felt is (0, -g sin r, -g cos r) and the rate is (dr/dt, 0, 0).
    """
    t = np.arange(n) / rate
    roll = 0.3 * np.sin(0.9 * t)
    rows = np.zeros((n, 7))
    rows[:, 0] = start + t
    rows[:, 1] = 0.27 * np.cos(0.9 * t)
    rows[:, 3] = 1e-3
    rows[:, 5] = -G * np.sin(roll)
    rows[:, 6] = -G * np.cos(roll)
    return rows


def fixes(n: int = 30, start: float = 100.0) -> np.ndarray:
    """Fixes of a vehicle that goes north at 10 m/s; columns as in GPS_HEADER, (n, 10)."""
    t = np.arange(n, dtype=float)
    rows = np.tile([0.0, 48.0, 11.0, 500.0, 10.0, 0.1, -0.2, 1.0, 1.5, 2.0], (n, 1))
    rows[:, 0] = start + t
    rows[:, 1] += t * 10.0 / 111e3
    return rows


def as_text(rows: np.ndarray, header: str, *, delimiter: str = ",", end: str = "\n", decimal: str = ".") -> str:
    lines = [header.replace(",", delimiter)]
    lines += [delimiter.join(f"{x:.9f}".replace(".", decimal) for x in row) for row in rows]
    return end.join(lines) + end


def write(path: Path, rows: np.ndarray, header: str) -> Path:
    path.write_text(as_text(rows, header), encoding="utf-8")
    return path


def noted(reading: Reading, *codes: Code) -> list[Finding]:
    """Findings of some codes about the whole of a file."""
    return [*of_code((each for each in reading.facts.evidence if isinstance(each, Finding)), *codes)]
