"""One screen of text about a run, from its facts."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from insnav.plain_text import plain_text
from insnav.report.numbers import number
from insnav.report.run.accuracy_table import STATISTICS, accuracy_rows

WIDTH = 100
LINES = 46
_MARGIN = 12
_FIRST_FILE = "report.html"
_NOTES = 4  # the others are in run.json
_DIVERGED = "filter.diverged"
_LATE = 0.02  # an offset of the clocks that matters [s]
_INSIDE = 0.95  # share inside 3 sd that needs no word
_MANY = 0.1  # share of rejected fixes that wants an explanation


def summary_lines(facts: Mapping[str, Any], folder: Path | None = None) -> list[str]:
    """Sum up a run on one screen.

    Parameters
    ----------
    facts : mapping
        As `insnav.report.run.quantities.run_facts` makes them, or read from ``run.json``.
    folder : Path, optional
        Where the files are.

    Returns
    -------
    list of str
        At most `LINES` lines of at most `WIDTH` characters.
    """
    lines: list[str] = []
    for kind, reading in facts["input"].items():
        lines += _entry(str(kind), _reading(reading))
    lines += _alignment(facts["alignment"])
    if facts["imu_model"]:
        model = facts["imu_model"]
        lines += _entry("IMU model", ": ".join(str(model[k]) for k in ("name", "chosen") if model.get(k)), rows=3)
    lines += _solution(facts)
    lines += _fixes(facts)
    lines += _accuracy(facts)
    lines += _smoothed(facts.get("smoothed"))
    files = _entry("files", f"{folder}{_file_names(facts)}", rows=2) if folder is not None else []
    return [*lines, *_notes(facts, LINES - len(lines) - len(files)), *files][-LINES:]


def _entry(name: str, text: str, rows: int = 1) -> list[str]:
    """Lay out a text of at most so many rows beside its name."""
    wrapped = textwrap.wrap(plain_text(text), WIDTH - _MARGIN, break_on_hyphens=False) or [""]
    if len(wrapped) > rows:
        wrapped = [*wrapped[: rows - 1], _cut(" ".join(wrapped[rows - 1 :]), WIDTH - _MARGIN)]
    names = [_cut(plain_text(name), _MARGIN - 1)] + [""] * len(wrapped)
    return [f"{each:<{_MARGIN}}{row}" for each, row in zip(names, wrapped, strict=False)]


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else text[: width - 1] + "…"


def _path(text: object, width: int) -> str:
    """Shorten a path from the left: its end tells most."""
    plain = plain_text(text)
    return plain if len(plain) <= width else "…" + plain[len(plain) - width + 1 :]


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
    if facts.get("axes"):
        parts.append(str(facts["axes"]))
    text = ", ".join(parts)
    return f"{text}  {_path(facts['path'], WIDTH - _MARGIN - len(text) - 2)}" if facts.get("path") else text


def _alignment(facts: Mapping[str, Any]) -> list[str]:
    roll, pitch = (number(facts[f"{name}_deg"]) for name in ("roll", "pitch"))
    tilt = max(facts["sd_tilt_north_deg"] or 0.0, facts["sd_tilt_east_deg"] or 0.0)
    heading = f"{number(facts['heading_deg'], 4)} ± {number(facts['sd_heading_deg'], 2)} deg"
    return [
        *_entry(
            "alignment",
            f"roll {roll}, pitch {pitch}, each ± {number(tilt, 2)} deg; heading {heading}; at {facts['time_s']:.1f} s",
        ),
        *_entry("", f"level: {facts['level_method']}; heading: {facts['heading_method']}"),
    ]


def _solution(facts: Mapping[str, Any]) -> list[str]:
    solution = facts["solution"]
    if not solution["rows"]:
        return _entry("solution", "empty")
    lines = _entry(
        "solution",
        f"{solution['rows']} rows, {_duration(solution['duration_s'])} ({_duration(solution['moving_s'])} moving), "
        f"{_distance(solution['distance_m'])}",
    )
    end = solution["end"]
    if "sd_position_m" in end:
        groups = (
            ("position", "sd_position_m", "m"),
            ("velocity", "sd_velocity_m_s", "m/s"),
            ("attitude", "sd_roll_pitch_heading_deg", "deg"),
        )
        sd = [f"{name} {' '.join(number(x, 2) for x in end[key])} {unit}" for name, key, unit in groups]
        lines += _entry("sd at end", ", ".join(sd), rows=2)
    sensor = facts["sensor_errors"]
    found = [
        f"{name} {' '.join(number(x) for x in sensor[key])} {unit}"
        for name, key, unit in (
            ("gyro", "gyro_bias_deg_h", "deg/h"),
            ("accelerometer", "accel_bias_mg", "mg"),
        )
        if key in sensor
    ]
    return lines + (_entry("biases", ", ".join(found)) if found else [])


def _fixes(facts: Mapping[str, Any]) -> list[str]:
    fixes = facts["fixes"]
    lines: list[str] = []
    for group in ("position", "velocity"):
        counts = fixes[group]
        if counts["offered"]:
            nis = counts["nis_mean_per_axis"]
            rms = next(value for key, value in counts.items() if key.startswith("innovation_rms"))
            unit = "m" if group == "position" else "m/s"
            lines += _entry(
                "" if lines else "fixes",
                f"{group}: {counts['used']} of {counts['offered']} used, innovation RMS "
                f"{' '.join(number(x, 2) for x in rms)} {unit}, NIS {number(nis, 2)} (1 is right)",
            )
    if not lines:
        lines += _entry("fixes", "none")
    if fixes["delay_s"] or fixes["delay_sd_s"]:
        lines += _entry("", f"delay {fixes['delay_s']:.3f} ± {fixes['delay_sd_s']:.3f} s{_clock(fixes)}", 2)
    if any(fixes.get("lever_arm_sd_m", ())):
        lines += _entry(
            "",
            f"lever arm {' '.join(f'{v:.3f}' for v in fixes['lever_arm_m'])} ± "
            f"{' '.join(f'{v:.3f}' for v in fixes['lever_arm_sd_m'])} m, estimated",
        )
    reasons = "; ".join(f"{count} by {reason}" for reason, count in fixes["rejected_for"].items())
    lines += _entry("rejected", reasons or "none", rows=2)
    for number_of, aid in enumerate(facts.get("aiding", [])):
        lines += _entry(
            "" if number_of else "aiding",
            f"{aid['name']}: {aid['processed'] - aid['rejected']} of {aid['processed']} accepted, innovation RMS "
            f"{number(aid['innovation_rms'], 2)} {aid['unit']}, NIS {number(aid['nis'], 2)}",
        )
    outages = facts["outages"]
    if outages:
        longest = max(outage["duration_s"] for outage in outages)
        total = sum(outage["duration_s"] for outage in outages)
        together = f", together {total:.1f} s" if len(outages) > 1 else ""
        lines += _entry("outages", f"{len(outages)}, the longest {longest:.1f} s{together}")
    return lines


def _accuracy(facts: Mapping[str, Any]) -> list[str]:
    accuracy = facts["accuracy"]
    if not accuracy or not accuracy.get("all"):
        return _entry("accuracy", "not known: no reference was given (--ref)")
    parts, rows = accuracy_rows(accuracy)
    wide = 8 * len(STATISTICS)
    name = 28
    epochs = f"error at {accuracy['epochs']} epochs of "
    lines = [
        *_entry("accuracy", epochs + _path(accuracy["reference"], WIDTH - _MARGIN - len(epochs))),
        " " * name + "".join(f"{part:>{wide}}" for part in parts),
        " " * name + "".join(f"{title:>8}" for _ in parts for _, title in STATISTICS),
    ]
    lines += [f"  {text:<{name - 2}}" + "".join(f"{cell:>8}" for cell in cells) for text, cells in rows]
    lines.append(
        f"  CEP50 {number(accuracy['all']['cep50_m'])} m, R95 {number(accuracy['all']['r95_m'])} m"
        + _inside(accuracy["consistency"])
    )
    return [line[:WIDTH] for line in lines]


def _smoothed(facts: Mapping[str, Any] | None) -> list[str]:
    if facts is None:
        return []
    if "accuracy" in facts:
        accuracy = facts["accuracy"]
        rms, by = accuracy["all"]["horizontal_m"]["rms"], facts["horizontal_rms_by_filter"]
        return _entry(
            "smoothed",
            f"horizontal RMS {number(rms)} m, {number(by, 2)} times that of the filter"
            + _inside(accuracy["consistency"]),
            rows=2,
        )
    sd, by = facts["horizontal_sd_m"], facts["horizontal_sd_by_filter"]
    return _entry("smoothed", f"horizontal sd {number(sd, 2)} m, {number(by, 2)} times that of the filter")


def _inside(consistency: Mapping[str, Any] | None) -> str:
    if consistency is None:
        return ""
    shares = [f"{group} {100.0 * figures['inside_3_sd']:.1f} %" for group, figures in consistency.items() if figures]
    return f"; inside 3 sd: {', '.join(shares)}" if shares else ""


def _notes(facts: Mapping[str, Any], room: int) -> list[str]:
    """As many assumptions and warnings as there is room for, first that filter and fixes do not go together."""
    texts = [plain_text(text) for text in facts["warnings"]]
    if facts["events"].get(_DIVERGED):  # said last, and matters most
        texts = [*texts[-1:], *texts[:-1]]
    texts = [*_many_rejected(facts["fixes"]), *_too_sure(facts), *texts]
    shown = texts[:_NOTES]
    rows = 2 if 2 * len(shown) < room else 1
    lines = [line for text in shown for line in _entry("note", text, rows)]
    if len(texts) > len(shown):
        lines += _entry("", f"{len(texts) - len(shown)} more notes in run.json")
    return lines[: max(room, 0)]


def _clock(fixes: Mapping[str, Any]) -> str:
    """Say on whose clock the solution is, where that makes a difference."""
    delay, sd = fixes["delay_s"], fixes["delay_sd_s"]
    if sd == 0.0 or abs(delay) < max(_LATE, 3.0 * sd):
        return ""
    return (
        "; laid to the clock of the IMU: the solution is in the time of the fixes. If the receiver is late instead, "
        f"give --gps-delay {delay:.3f}"
    )


def _too_sure(facts: Mapping[str, Any]) -> list[str]:
    """Say so if the reference is outside 3 sd much more often than it should be."""
    found = []
    for name, part in (("", facts.get("accuracy")), ("smoothed ", (facts.get("smoothed") or {}).get("accuracy"))):
        position = ((part or {}).get("consistency") or {}).get("position")
        if position and position["inside_3_sd"] < _INSIDE:
            found.append(
                f"{name}position is outside 3 sd at {100.0 * (1.0 - position['inside_3_sd']):.0f} % of the epochs: "
                "fixes whose errors last, figures of IMU or fixes that are too good, or errors of the reference"
            )
    return found[:1]


def _many_rejected(fixes: Mapping[str, Any]) -> list[str]:
    """Say so if so many fixes were rejected that the fixes are hardly to blame."""
    groups = [
        f"{100.0 * fixes[group]['rejected'] / fixes[group]['offered']:.0f} % of {group}"
        for group in ("position", "velocity")
        if fixes[group]["rejected"] > _MANY * fixes[group]["offered"]
    ]
    if not groups:
        return []
    causes = "is a heading, lever arm, axis, clock or standard deviation wrong?"
    return [f"many fixes were rejected, {' and '.join(groups)}: {causes} See innovations and events"]


def _file_names(facts: Mapping[str, Any]) -> str:
    """Names of files, each folder in it only once, what people read first."""
    found = dict.fromkeys(name.split("/")[0] for name in facts.get("files", {}))
    names = sorted(sorted(found), key=lambda name: (name != _FIRST_FILE, name))
    return f": {', '.join([*names, 'run.json'])}" if names else ""


def _duration(seconds: float) -> str:
    return f"{seconds / 60.0:.1f} min" if seconds >= 120.0 else f"{seconds:.1f} s"


def _distance(metres: float) -> str:
    return f"{metres / 1000.0:.2f} km" if metres >= 1000.0 else f"{metres:.1f} m"
