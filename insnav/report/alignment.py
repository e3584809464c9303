"""Facts and text of an alignment on its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from insnav.filter.fine import FineAlignment
from insnav.report.facts import alignment_facts as _one
from insnav.report.facts import json_ready
from insnav.report.labels import number
from insnav.units import DEG


def alignment_facts(found: FineAlignment, reading: Mapping[str, Any], imu_note: str, lat_deg: float) -> dict[str, Any]:
    """Gather what an alignment found, JSON-ready, units in the keys."""
    ready: dict[str, Any] = json_ready(
        {
            "input": {"imu": reading},
            "imu_model": imu_note,
            "coarse": _one(found.coarse),
            "fine": _one(found.fine) if found.fine is not None else None,
            "latitude_given_deg": lat_deg,
            "latitude_from_sensors_deg": found.sensor_latitude / DEG,
        }
    )
    return ready


def alignment_lines(facts: Mapping[str, Any]) -> list[str]:
    """Sum up an alignment in a few lines."""
    lines = []
    for name in ("coarse", "fine"):
        found = facts[name]
        if found is None:
            continue
        heading, sd = found["heading_deg"], found["sd_heading_deg"]
        head = f"{number(heading)} ± {number(sd)} deg ({found['heading_method']})"
        if sd is None:
            head = "not found: give it with --heading, or choose a better IMU model with --imu"
        roll, pitch, tilt = (number(found[f"{key}_deg"]) for key in ("roll", "pitch", "sd_tilt_north"))
        lines += [
            f"{name:<12}roll {roll}, pitch {pitch} ± {tilt} deg ({found['level_method']})",
            f"{'':<12}heading {head}",
        ]
    lines.append(
        f"{'latitude':<12}{facts['latitude_given_deg']:.4f} deg given, "
        f"{facts['latitude_from_sensors_deg']:.4f} deg from the sensors alone"
    )
    return lines
