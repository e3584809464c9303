"""``insnav drift``: what the drift of a gyro depends on, and what smoothing it does."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from insnav.cli import parse
from insnav.cli.console import note, result_page, working
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

        found, table = studied(file, columns=parse.columns(columns, "--columns"))
        stage("writing")
        from insnav.imu import calibration_to_toml
        from insnav.report.calibration.common import bench_input
        from insnav.report.drift.page import drift_page, rates_csv
        from insnav.report.save import write_page

        page = drift_page(found, table.name)
        for text in page.warnings:
            note(text)
        texts = {"calibration.toml": calibration_to_toml(found.errors), "rates.csv": rates_csv(found)}
        where = write_page(folder, page, {"command": "drift", "input": bench_input([table])[0]}, texts)
    result_page(where, page, out, as_json=as_json, more=texts)
