"""One drive, and the writers that spell it in files: columns as text, headers, delimiters."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import insnav

START = 408600.0  # seconds of GPS week 2381: 28 August 2025, 17:30:00 GPS time
UNIX = 315964800.0 + 2381 * 604800.0 - 18.0  # Unix time of the start of that week [s]
FROM, TO = 48.0, 215.0  # of the motion: the end of a rest, bends, a hill [s]
DEG = np.pi / 180.0
G0 = 9.80665


@dataclass(frozen=True)
class Recorded:
    """A drive: samples in forward, right, down, and fixes."""

    t: np.ndarray  # (n,) [s] of the GPS week
    gyro: np.ndarray  # (n, 3) [rad/s]
    accel: np.ndarray  # (n, 3) [m/s^2]
    gps_t: np.ndarray  # (m,) [s]
    lla: np.ndarray  # (m, 3) [deg], [deg], [m]
    v: np.ndarray  # (m, 3) [m/s]
    sd: np.ndarray  # (m, 6)


@functools.cache
def drive() -> Recorded:
    """City traffic with stops and bends, 50 Hz and 5 Hz."""
    made = insnav.simulate("city", imu="tactical", gps="rtk", seed=3, rate=50.0)
    imu, gps = made.imu.data, made.gps.data
    i, k = ((each.time >= FROM) & (each.time < TO) for each in (imu, gps))
    lla = np.column_stack([gps.lla[:, :2] / DEG, gps.lla[:, 2]])
    sd = np.column_stack([gps.position_sd, gps.velocity_sd])
    return Recorded(START + imu.time[i], imu.gyro[i], imu.accel[i], START + gps.time[k], lla[k], gps.v_n[k], sd[k])


def text(values: np.ndarray, decimals: int = 9) -> list[str]:
    return [f"{value:.{decimals}f}" for value in values]


def table(
    path: Path,
    columns: Sequence[tuple[str, Sequence[str]]],
    *,
    delimiter: str = ",",
    before: str = "",
    under: str = "",
    header: bool = True,
    end: str = "\n",
    change: Callable[[str], str] = lambda each: each,
) -> Path:
    """Write columns, header and texts each; `change` is applied to every row of numbers."""
    lines = [change(delimiter.join(row)) for row in zip(*(cells for _, cells in columns), strict=True)]
    head = [delimiter.join(name for name, _ in columns)] if header else []
    path.write_text(before + end.join([*head, *([under] if under else []), *lines]) + end, encoding="utf-8")
    return path


def samples(
    headers: str,
    time: Callable[[np.ndarray], list[str]] | None = None,
    *,
    gyro: float = 1.0,
    accel: float = 1.0,
    matrix: np.ndarray | None = None,
) -> list[tuple[str, list[str]]]:
    """Columns of an IMU: headers of time, gyro and accel between commas, values divided by the unit's size in SI.

    `matrix` (3, 3): from forward, right, down to the axes of the sensor.
    """
    made, turn = drive(), np.eye(3) if matrix is None else matrix
    w, f = made.gyro @ turn.T / gyro, made.accel @ turn.T / accel
    cells = [text(made.t, 4) if time is None else time(made.t), *map(text, w.T), *map(text, f.T)]
    return list(zip(headers.split(","), cells, strict=True))


def fixes(
    headers: str, time: Callable[[np.ndarray], list[str]] | None = None, **changed: list[str]
) -> list[tuple[str, list[str]]]:
    """Columns of fixes: as many headers as wanted of time, lat, lon, height, vn, ve, vd, six deviations.

    `changed`: texts by canonical key.
    """
    made = drive()
    keys = ["time", "lat", "lon", "height", "vn", "ve", "vd", "sd_n", "sd_e", "sd_d", "sd_vn", "sd_ve", "sd_vd"]
    values = [*made.lla.T, *made.v.T, *made.sd.T]
    cells = [text(made.gps_t, 3) if time is None else time(made.gps_t), *(text(each, 10) for each in values)]
    return [
        (header, changed.get(key, cell)) for header, key, cell in zip(headers.split(","), keys, cells, strict=False)
    ]


IMU_HEADERS = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
GPS_HEADERS = "time_s,lat_deg,lon_deg,height_m,vn_m_s,ve_m_s,vd_m_s,sd_n_m,sd_e_m,sd_d_m,sd_vn_m_s,sd_ve_m_s,sd_vd_m_s"
