"""``insnav check``: content and problems of files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from insnav.cli.console import Stages, brief_text, result, result_facts
from insnav.cli.data_options import READING, Data, compile_at_first, takes_data
from insnav.cli.options import RESULT, Force, Json, argument, option


@takes_data(None, only=(*READING, "time_offset", "topic", "lever_arm", "gps_height", "gps_columns"))
def check(
    data: Data,
    files: Annotated[list[Path], argument("FILES", "Files.")],
    out: Annotated[Path | None, option(RESULT, "FOLDER", "Also write a page and run.json there.")] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Examine files."""
    with Stages() as stage:
        from insnav.session.check import check as checked

        compile_at_first(*files, *filter(None, (data.gps, data.ref)))
        stage("reading")
        found = replace(checked(*files, gps=data.gps, ref=data.ref, **data.inputs), options=data.options)
    where = None
    if out is not None:
        where = found.save(out, force=force, figures="page")
    if as_json:
        if where is not None:
            result_facts(where)
        else:
            from insnav.report.save import facts_of, versions

            result(json.dumps({"kind": "check", "versions": versions(), **facts_of(found)}, indent=2))
    else:
        result(brief_text(found))
    if not found.found.runs_as_given:
        raise typer.Exit(1)
