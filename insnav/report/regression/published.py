"""``published.md``: published GNSS outage figures, the same tests simulated, and the field factor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from insnav.regression.provenance import Origin
from insnav.regression.published.replicas import Compared, FieldFactor
from insnav.report.numbers import number

FILE = "published.md"


def write_published(folder: Path, compared: Sequence[Compared], field: FieldFactor, now: Origin) -> Path:
    """Write the table into a folder."""
    path = folder / FILE
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(published_text(compared, field, now), encoding="utf-8", newline="\n")
    return path


def published_text(compared: Sequence[Compared], field: FieldFactor, now: Origin) -> str:
    """Lay out the table in Markdown."""
    rows = [_row(each) for each in compared]
    own = [f"| {name} | {ratio:.2f} |" for name, ratio in sorted(field.ratios.items(), key=lambda item: item[1])]
    missing = sorted({f"{each.case.imu}: {', '.join(each.missing)}" for each in compared if each.missing})
    places = sorted({f"{each.case.source.split(',')[0]}: {each.case.where}" for each in compared})
    return "\n".join(
        [
            "# Published outage figures, simulated again",
            "",
            f"Version {now.version}, commit {now.commit}, {now.date}; made by `insnav regress --published`.",
            "",
            "Each replica has the published figures of the IMU and no others, a drive of the same kind (profile "
            "`city`, three seeds), RTK fixes, outages every 15 s, and the statistic that was published. Interval: 95 % "
            "of an RMS of as many outages as do not overlap.",
            "",
            "| test | IMU | outage [s] | statistic | published [m] | simulated [m] | ratio | why they differ |",
            "| --- | --- | ---: | --- | ---: | ---: | ---: | --- |",
            *rows,
            "",
            "## Field factor",
            "",
            f"Recorded over predicted error: **{field.typical:.2f}** ({field.interval[0]:.2f} to "
            f"{field.interval[1]:.2f}), geometric mean of {len(field.ratios)} tests with its 95 % interval; 95 % of "
            f"further tests are within **{field.span[0]:.2f} to {field.span[1]:.2f}**. Published tests after their "
            "outage, recorded drives of the corpus after a minute without GPS.",
            "",
            "| test | recorded / predicted |",
            "| --- | ---: |",
            *own,
            "",
            "## What is not published of these IMUs, and zero in the replicas",
            "",
            *(f"- {line}" for line in missing),
            "",
            "## Sources",
            "",
            *(f"- {line}" for line in places),
            "",
        ]
    )


def _row(each: Compared) -> str:
    low, high = each.interval
    cells = (
        each.case.source,
        each.case.imu,
        f"{each.case.length:g}",
        each.case.statistic,
        number(each.case.value),
        f"{number(each.replica)} ({number(low)} … {number(high)})",
        f"{each.ratio:.2f}",
        each.case.reason,
    )
    return f"| {' | '.join(cells)} |"
