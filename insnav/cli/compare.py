"""``insnav compare``: accuracy of runs against a reference, side by side."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from insnav.cli import parse

HELP = """Accuracy of several runs against one reference, side by side.

\b
Examples:
  insnav compare run1 run2 --ref ref.csv
  insnav compare run1 --ref rtk.csv --ref-lever-arm 0.8,-0.3,-1.2 --json
"""


def compare(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Run folders.")],
    ref: Annotated[Path, typer.Option(help="Reference trajectory.")],
    ref_lever_arm: Annotated[
        str | None, typer.Option(help="Point of the reference seen from the IMU, body axes, m. [0,0,0]")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the table as JSON.")] = False,
) -> None:
    """Compare runs."""
    from insnav.io import read_reference
    from insnav.report.compare import compare as table
    from insnav.report.compare import comparison_lines
    from insnav.report.facts import json_ready

    lever_b = parse.vector(ref_lever_arm, "--ref-lever-arm") if ref_lever_arm else None
    rows = table(runs, read_reference(ref).data, lever_b=lever_b)
    if as_json:
        print(json.dumps(json_ready(rows), indent=1, ensure_ascii=False))
    else:
        print("\n".join(comparison_lines(rows)))
