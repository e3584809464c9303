"""Facts and text of an alignment on its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from insnav.earth import OMEGA_EARTH
from insnav.filter.fine_alignment import FineAlignment
from insnav.imu.specification import ImuSpec, gyro_bias_sd
from insnav.report.numbers import number
from insnav.report.run.quantities import alignment_facts as _one
from insnav.report.run_json import json_ready
from insnav.units import DEG

_MARGIN = 12
_USEFUL = 10.0  # a latitude from the sensors less sure than this tells nothing [deg]


def alignment_facts(
    found: FineAlignment, reading: Mapping[str, Any], spec: ImuSpec, imu_note: str, lat_deg: float
) -> dict[str, Any]:
    """Gather what an alignment found, JSON-ready, units in the keys.

    Parameters
    ----------
    found : FineAlignment
        The alignment.
    reading : mapping
        What was understood of the IMU file.
    spec : ImuSpec
        IMU model in use.
    imu_note : str
        How it was chosen.
    lat_deg : float
        Latitude as given [deg].
    """
    ready: dict[str, Any] = json_ready(
        {
            "input": {"imu": reading},
            "imu_model": {"name": spec.name, "chosen": imu_note, "source": spec.source},
            "coarse": _one(found.coarse),
            "fine": _one(found.fine) if found.fine is not None else None,
            "latitude_given_deg": lat_deg,
            "latitude_from_sensors_deg": found.sensor_latitude / DEG,
            "latitude_from_sensors_sd_deg": _latitude_sd(spec),
        }
    )
    return ready


def _latitude_sd(spec: ImuSpec) -> float:
    """How far gyro bias turns the measured Earth rate, at most a right angle [deg]."""
    bias = float(np.max(gyro_bias_sd(spec.gyro)))
    return min(bias / OMEGA_EARTH / DEG, 90.0)


def alignment_lines(facts: Mapping[str, Any]) -> list[str]:
    """Sum up an alignment in a few lines.

    Parameters
    ----------
    facts : mapping
        As `alignment_facts` makes them.

    Returns
    -------
    list of str
    """
    start, end = (round(time, 1) + 0.0 for time in facts["coarse"]["static_s"])
    lines = [_entry("static", f"{start:.1f} to {end:.1f} s, {end - start:.1f} s long")]
    for name in ("coarse", "fine"):
        found = facts[name]
        if found is not None:
            tilt = max(found["sd_tilt_north_deg"], found["sd_tilt_east_deg"])
            roll, pitch = (number(found[f"{key}_deg"], 4) for key in ("roll", "pitch"))
            lines += [
                _entry(name, f"roll {roll}, pitch {pitch}, each ± {number(tilt, 2)} deg  ({found['level_method']})"),
                _entry("", f"heading {_heading(found)}"),
            ]
    given, sd = facts["latitude_given_deg"], facts["latitude_from_sensors_sd_deg"]
    told = "not to be told from the sensors alone: their bias hides the Earth's rotation"
    if sd < _USEFUL:
        told = f"{facts['latitude_from_sensors_deg']:.4f} ± {number(sd, 2)} deg from the sensors alone"
    return [*lines, _entry("latitude", f"{given:.4f} deg given, {told}")]


def _entry(name: str, text: str) -> str:
    return f"{name:<{_MARGIN}}{text}"


def _heading(found: Mapping[str, Any]) -> str:
    if found["sd_heading_deg"] is None:
        return "not found: the gyros do not show the Earth's rotation well enough; give --heading, or a better --imu"
    heading, sd = number(found["heading_deg"], 5), number(found["sd_heading_deg"], 2)
    return f"{heading} ± {sd} deg  ({found['heading_method']})"
