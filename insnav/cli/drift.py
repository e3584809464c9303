"""``insnav drift``: causes of gyro drift, and effect of smoothing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from insnav.cli import parse
from insnav.cli.console import note_warnings, result_page, working, write_result
from insnav.cli.options import Columns, Force, Json, Out, argument


def drift(
    file: Annotated[Path, argument("FILE", "Record of the bench.")],
    columns: Columns = None,
    out: Out = Path("drift"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Study the drift of gyros."""
    with working(out, force) as (folder, stage):
        stage("reading")
        from insnav.session.bench import drift as studied

        outcome = studied(file, columns=parse.columns(columns, "--columns"))
        note_warnings(outcome)
        where = write_result(outcome, folder, stage, figures="png")
    result_page(where, outcome.page(), out, as_json=as_json, more=("calibration.toml", "rates.csv"))
