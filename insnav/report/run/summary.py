"""One screen of text about a run, from its ``run.json``."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from insnav.plain_text import plain_text
from insnav.report.numbers import number
from insnav.report.page import STATISTICS
from insnav.report.run.quantities import PARTS, SHOWN_ERRORS, SHOWN_STATISTICS

WIDTH = 100
LINES = 46
_MARGIN = 12
_FIRST_FILE = "report.html"
_NOTES = 4  # the others are in run.json
_LATE = 0.02  # an offset of the clocks that matters [s]


def summary_lines(facts: Mapping[str, Any], folder: Path | None = None) -> list[str]:
    """Sum up a run on one screen.

    `facts`: content of ``run.json``.
    """
    lines: list[str] = []
    for kind, reading in facts.get("input", {}).items():
        lines += _entry(str(kind), _reading(reading))
    lines += _alignment(facts["alignment"])
    model = facts.get("imu_model")
    if model:
        lines += _entry("IMU model", ": ".join(str(model[k]) for k in ("name", "chosen") if model.get(k)), rows=3)
    lines += [*_solution(facts), *_named("fixes", _fixes(facts["fixes"]))]
    reasons = "; ".join(f"{count} by {reason}" for reason, count in facts["fixes"]["rejected_for"].items())
    lines += [*_entry("rejected", reasons or "none", rows=2), *_named("aiding", _aiding(facts["aiding"]))]
    lines += [*_outages(facts["outages"]), *_accuracy(facts["accuracy"]), *_smoothed(facts["smoothed"])]
    files = _entry("files", f"{folder}{_file_names(facts)}", rows=2) if folder is not None else []
    return [*lines, *_notes(facts, LINES - len(lines) - len(files)), *files][-LINES:]


def _entry(name: str, text: str, rows: int = 1) -> list[str]:
    """Lay out a text of at most so many rows next to its name."""
    wrapped = textwrap.wrap(plain_text(text), WIDTH - _MARGIN, break_on_hyphens=False) or [""]
    if len(wrapped) > rows:
        wrapped = [*wrapped[: rows - 1], _cut(" ".join(wrapped[rows - 1 :]), WIDTH - _MARGIN)]
    names = [_cut(plain_text(name), _MARGIN - 1)] + [""] * len(wrapped)
    return [f"{each:<{_MARGIN}}{row}" for each, row in zip(names, wrapped, strict=False)]


def _named(name: str, texts: Iterator[str]) -> list[str]:
    """Entries of which the first has the name."""
    return [line for i, text in enumerate(texts) for line in _entry("" if i else name, text, rows=2)]


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
    tilt = max(facts["tilt_north_sd_deg"] or 0.0, facts["tilt_east_sd_deg"] or 0.0)
    heading = f"{number(facts['heading_deg'], 4)} ± {number(facts['heading_sd_deg'], 2)} deg"
    text = f"roll {roll}, pitch {pitch}, each ± {number(tilt, 2)} deg; heading {heading}; at {facts['time_s']:.1f} s"
    methods = f"level: {facts['level_method']}; heading: {facts['heading_method']}"
    return [*_entry("alignment", text), *_entry("", methods)]


def _solution(facts: Mapping[str, Any]) -> list[str]:
    solution = facts["solution"]
    if not solution["rows"]:
        return _entry("solution", "empty")
    lines = _entry(
        "solution",
        f"{solution['rows']} rows, {_duration(solution['duration_s'])} ({_duration(solution['moving_s'])} moving), "
        f"{_distance(solution['distance_m'])}",
    )
    end, sensor = solution["end"], facts.get("sensor_errors", {})
    sd = (
        ("position", "position_sd_m", "m"),
        ("velocity", "velocity_sd_m_s", "m/s"),
        ("attitude", "attitude_sd_deg", "deg"),
    )
    biases = (("gyro", "gyro_bias_deg_h", "deg/h"), ("accelerometer", "accel_bias_mg", "mg"))
    for heading, found, groups, digits in (("sd at end", end, sd, 2), ("biases", sensor, biases, 3)):
        shown = [
            f"{name} {' '.join(number(x, digits) for x in found[key])} {unit}"
            for name, key, unit in groups
            if key in found
        ]
        lines += _entry(heading, ", ".join(shown), rows=2) if shown else []
    return lines


def _fixes(fixes: Mapping[str, Any]) -> Iterator[str]:
    processed = [group for group in ("position", "velocity") if fixes[group]["processed"]]
    for group in processed:
        counts, unit = fixes[group], "m" if group == "position" else "m/s"
        rms = next(value for key, value in counts.items() if key.startswith("innovation_rms"))
        nis = number(counts["nis_mean_per_axis"], 2)
        yield (
            f"{group}: {counts['accepted']} of {counts['processed']} accepted, innovation RMS "
            f"{' '.join(number(x, 2) for x in rms)} {unit}, NIS {nis} (1 ideal)"
        )
    if not processed:
        yield "none"
    if fixes["delay_s"] or fixes["delay_sd_s"]:
        yield f"delay {fixes['delay_s']:.3f} ± {fixes['delay_sd_s']:.3f} s{_clock(fixes)}"
    if any(fixes.get("lever_arm_sd_m", ())):
        values, sds = (" ".join(f"{v:.3f}" for v in fixes[f"lever_arm_{key}"]) for key in ("m", "sd_m"))
        yield f"lever arm {values} ± {sds} m, estimated"


def _aiding(kinds: list[Mapping[str, Any]]) -> Iterator[str]:
    for each in kinds:
        key = next(key for key in each if key.startswith("innovation_rms_"))
        unit = key.removeprefix("innovation_rms_").replace("_", "/")
        yield (
            f"{each['name']}: {each['processed'] - each['rejected']} of {each['processed']} accepted, innovation RMS "
            f"{number(each[key], 2)} {unit}, NIS {number(each['nis'], 2)}"
        )


def _outages(outages: list[Mapping[str, Any]]) -> list[str]:
    if not outages:
        return []
    lengths = [outage["duration_s"] for outage in outages]
    total = f", together {sum(lengths):.1f} s" if len(outages) > 1 else ""
    return _entry("outages", f"{len(outages)}, the longest {max(lengths):.1f} s{total}")


def _accuracy(accuracy: Mapping[str, Any] | None) -> list[str]:
    if not accuracy or not accuracy.get("all"):
        return _entry("accuracy", "not known: no reference was given (--ref)")
    parts = [part for part in PARTS if accuracy.get(part)]
    if len(parts) == 2:  # the run is all static or all moving
        parts = ["all"]
    name, wide = 28, 8 * len(SHOWN_STATISTICS)
    epochs = f"error at {accuracy['epochs']} epochs of "
    lines = [
        *_entry("accuracy", epochs + _path(accuracy["reference"], WIDTH - _MARGIN - len(epochs))),
        " " * name + "".join(f"{part:>{wide}}" for part in parts),
        " " * name + "".join(f"{STATISTICS[each]:>8}" for _ in parts for each in SHOWN_STATISTICS),
    ]
    for each in SHOWN_ERRORS:
        key = next(iter(each.facts()))
        if accuracy["all"].get(key) is not None:
            errors = [accuracy[part].get(key) or {} for part in parts]
            cells = "".join(f"{number(figures.get(which)):>8}" for figures in errors for which in SHOWN_STATISTICS)
            lines.append(f"  {f'{each.label} [{each.shown_unit}]':<{name - 2}}{cells}")
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
        rms, by = accuracy["all"]["horizontal_m"]["rms"], facts["horizontal_rms_ratio"]
        text = f"horizontal RMS {number(rms)} m, {number(by, 2)} times the filtered{_inside(accuracy['consistency'])}"
        return _entry("smoothed", text, rows=2)
    sd, by = facts["horizontal_sd_m"], facts["horizontal_sd_ratio"]
    return _entry("smoothed", f"horizontal sd {number(sd, 2)} m, {number(by, 2)} times the filtered")


def _inside(consistency: Mapping[str, Any] | None) -> str:
    shares = [f"{group} {100.0 * each['inside_3_sd']:.1f} %" for group, each in (consistency or {}).items() if each]
    return f"; inside 3 sd: {', '.join(shares)}" if shares else ""


def _notes(facts: Mapping[str, Any], room: int) -> list[str]:
    """As many warnings and notes as there is room for."""
    texts = [("warning", text) for text in facts["warnings"]] + [("note", text) for text in facts["notes"]]
    shown = texts[:_NOTES]
    rows = 2 if 2 * len(shown) < room else 1
    lines = [line for name, text in shown for line in _entry(name, text, rows)]
    if len(texts) > len(shown):
        lines += _entry("", f"{len(texts) - len(shown)} more notes in run.json")
    return lines[: max(room, 0)]


def _clock(fixes: Mapping[str, Any]) -> str:
    """Say on whose clock the solution is, where that makes a difference."""
    delay, sd = fixes["delay_s"], fixes["delay_sd_s"]
    if sd == 0.0 or abs(delay) < max(_LATE, 3.0 * sd):
        return ""
    return f", attributed to the IMU clock: solution in GPS time; if the receiver is late, give --gps-delay {delay:.3f}"


def _file_names(facts: Mapping[str, Any]) -> str:
    """Names of files, each folder in it only once, what people read first."""
    found = dict.fromkeys(name.split("/")[0] for name in facts.get("files", {}))
    names = sorted(sorted(found), key=lambda name: (name != _FIRST_FILE, name))
    return f": {', '.join([*names, 'run.json'])}" if names else ""


def _duration(seconds: float) -> str:
    return f"{seconds / 60.0:.1f} min" if seconds >= 120.0 else f"{seconds:.1f} s"


def _distance(metres: float) -> str:
    return f"{metres / 1000.0:.2f} km" if metres >= 1000.0 else f"{metres:.1f} m"
