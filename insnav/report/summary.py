"""One screen of text about a run, from its facts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from insnav.io.text import plain_text
from insnav.report.accuracy_table import STATISTICS, accuracy_rows
from insnav.report.labels import number

WIDTH = 100
LINES = 40
_MARGIN = 12
_FIRST_FILE = "report.html"
_WARNINGS = 4  # more are in report.html


def summary_lines(facts: Mapping[str, Any], folder: Path | None = None) -> list[str]:
    """Sum up a run on one screen.

    Parameters
    ----------
    facts : mapping
        As `insnav.report.facts.run_facts` makes them, or read from ``run.json``.
    folder : Path, optional
        Where the files are.

    Returns
    -------
    list of str
        At most `LINES` lines of at most `WIDTH` characters.
    """
    lines: list[str] = []
    for kind, reading in facts["input"].items():
        lines.append(_entry(str(kind), _reading(reading)))
    lines += _alignment(facts["alignment"])
    if facts["imu_model"]:
        model = facts["imu_model"]
        lines.append(_entry("IMU model", "; ".join(str(model[k]) for k in ("name", "chosen") if model.get(k))))
    lines += _solution(facts)
    lines += _fixes(facts)
    lines += _accuracy(facts)
    warnings = [plain_text(text) for text in facts["warnings"]]
    lines += [_entry("warning", text) for text in warnings[:_WARNINGS]]
    if len(warnings) > _WARNINGS:
        lines.append(_entry("", f"{len(warnings) - _WARNINGS} more warnings in run.json"))
    if folder is not None:
        lines.append(_entry("files", f"{folder}{_file_names(facts)}"))
    return lines[:LINES]


def _entry(name: str, text: str) -> str:
    line = f"{plain_text(name):<{_MARGIN}}{plain_text(text)}"
    return line if len(line) <= WIDTH else line[: WIDTH - 1] + "…"


def _reading(facts: Mapping[str, Any]) -> str:
    parts = []
    if facts.get("n_rows") is not None:
        rows, used = facts["n_rows"], facts.get("n_used", facts["n_rows"])
        parts.append(f"{rows} rows" if rows == used else f"{used} of {rows} rows")
    start, end = facts.get("start_s"), facts.get("end_s")
    if start is not None and end is not None:
        parts.append(f"{start:.1f} to {end:.1f} s")
    if facts.get("rate_hz") is not None:
        parts.append(f"{facts['rate_hz']:.4g} Hz")
    if facts.get("n_gaps") is not None:
        gaps = facts["n_gaps"]
        parts.append(f"{gaps} gap{'s' * (gaps > 1)}, longest {facts['longest_gap_s']:.3g} s" if gaps else "no gaps")
    parts += [str(facts[key]) for key in ("axes", "sampling", "height") if facts.get(key)]
    # The name comes last to be cut first: everything else is short.
    return ", ".join(parts) + f"  {facts['path']}" if facts.get("path") else ", ".join(parts)


def _alignment(facts: Mapping[str, Any]) -> list[str]:
    angles = (
        f"roll {number(facts['roll_deg'])}, pitch {number(facts['pitch_deg'])}, "
        f"heading {number(facts['heading_deg'], 4)} deg"
    )
    sd = [facts[key] for key in ("sd_tilt_north_deg", "sd_tilt_east_deg", "sd_heading_deg")]
    methods = f"{facts['level_method']}; heading: {facts['heading_method']}"
    return [
        _entry("alignment", f"{angles}, sd {', '.join(number(x) for x in sd)} deg, at {facts['time_s']:.1f} s"),
        _entry("", methods),
    ]


def _solution(facts: Mapping[str, Any]) -> list[str]:
    solution = facts["solution"]
    if not solution["rows"]:
        return [_entry("solution", "empty")]
    lines = [
        _entry(
            "solution",
            f"{solution['rows']} rows, {_duration(solution['duration_s'])}, of it moving "
            f"{_duration(solution['moving_s'])}, {_distance(solution['distance_m'])}",
        )
    ]
    end = solution["end"]
    if "sd_position_m" in end:
        position, velocity, attitude = (
            " ".join(number(x) for x in end[key])
            for key in ("sd_position_m", "sd_velocity_m_s", "sd_roll_pitch_heading_deg")
        )
        lines.append(_entry("sd at end", f"{position} m, {velocity} m/s, {attitude} deg"))
    sensor = facts["sensor_errors"]
    found = [
        f"{name} {' '.join(number(x) for x in sensor[key])} {unit}"
        for name, key, unit in (
            ("gyro", "gyro_bias_deg_h", "deg/h"),
            ("accelerometer", "accel_bias_mg", "mg"),
        )
        if key in sensor
    ]
    return [*lines, _entry("biases", ", ".join(found))] if found else lines


def _fixes(facts: Mapping[str, Any]) -> list[str]:
    fixes = facts["fixes"]
    lines: list[str] = []
    for group in ("position", "velocity"):
        counts = fixes[group]
        if counts["offered"]:
            nis = counts["nis_mean_per_axis"]
            rms = next(value for key, value in counts.items() if key.startswith("innovation_rms"))
            unit = "m" if group == "position" else "m/s"
            lines.append(
                _entry(
                    "" if lines else "fixes",
                    f"{group}: {counts['used']} of {counts['offered']} used, innovation RMS "
                    f"{' '.join(number(x) for x in rms)} {unit}, NIS {number(nis)} (1 is right)",
                )
            )
    if not lines:
        lines.append(_entry("fixes", "none"))
    if fixes["delay_s"] or fixes["delay_sd_s"]:
        lines.append(_entry("", f"delay {fixes['delay_s']:.3f} s, sd {fixes['delay_sd_s']:.3f} s"))
    reasons = ", ".join(f"{count} by {reason}" for reason, count in fixes["rejected_for"].items())
    lines.append(_entry("rejected", reasons or "none"))
    outages = facts["outages"]
    if outages:
        longest = max(outage["duration_s"] for outage in outages)
        total = sum(outage["duration_s"] for outage in outages)
        lines.append(_entry("outages", f"{len(outages)}, the longest {longest:.1f} s, together {total:.1f} s"))
    return lines


def _accuracy(facts: Mapping[str, Any]) -> list[str]:
    accuracy = facts["accuracy"]
    if not accuracy or not accuracy.get("all"):
        return [_entry("accuracy", "no reference was given")]
    parts, rows = accuracy_rows(accuracy)
    wide = 8 * len(STATISTICS)
    name = 28
    lines = [
        _entry("accuracy", f"against {accuracy['reference']}: error at {accuracy['epochs']} epochs"),
        " " * name + "".join(f"{part:>{wide}}" for part in parts),
        " " * name + "".join(f"{title:>8}" for _ in parts for _, title in STATISTICS),
    ]
    lines += [f"  {text:<{name - 2}}" + "".join(f"{cell:>8}" for cell in cells) for text, cells in rows]
    lines.append(
        f"  CEP50 {number(accuracy['all']['cep50_m'])} m, R95 {number(accuracy['all']['r95_m'])} m"
        + _inside(accuracy["consistency"])
    )
    return [line[:WIDTH] for line in lines]


def _inside(consistency: Mapping[str, Any] | None) -> str:
    if consistency is None:
        return ""
    shares = [f"{group} {100.0 * figures['inside_3_sd']:.1f} %" for group, figures in consistency.items() if figures]
    return f"; inside 3 sd: {', '.join(shares)}" if shares else ""


def _file_names(facts: Mapping[str, Any]) -> str:
    names = sorted((name for name in facts.get("files", {}) if "/" not in name), key=_FIRST_FILE.__ne__)
    return f": {', '.join([*names, 'run.json', 'figures'])}" if names else ""


def _duration(seconds: float) -> str:
    return f"{seconds / 60.0:.1f} min" if seconds >= 120.0 else f"{seconds:.1f} s"


def _distance(metres: float) -> str:
    return f"{metres / 1000.0:.2f} km" if metres >= 1000.0 else f"{metres:.1f} m"
