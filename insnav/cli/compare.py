"""``insnav compare``: accuracy of runs against a reference, side by side."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from insnav.cli.console import brief_text, quiet_figures, result
from insnav.cli.data_options import Data, takes_data
from insnav.cli.options import RESULT, Force, Json, argument, option


@takes_data(None, files={"ref": True}, only=("ref_lever_arm", "ref_columns"))
def compare(
    data: Data,
    runs: Annotated[list[Path], argument("RUN", "Run folders.")],
    tum: Annotated[
        Path | None,
        option(
            RESULT, "FOLDER", "Also write the compared epochs for evo: a .tum file of each run, and of the reference."
        ),
    ] = None,
    out: Annotated[Path | None, option(RESULT, "FOLDER", "Also write figure and page into this folder.")] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compare runs."""
    from insnav.output.folder import RunFolder
    from insnav.session.comparison import compare as compared

    assert data.ref is not None
    outcome = replace(compared(*runs, ref=data.ref, **data.inputs), options=data.options)
    if out is not None:
        quiet_figures()
        outcome.save(out, force=force)
    found = outcome.found
    if tum is not None:
        from insnav.output.track_files import tum_files

        errors = {name: (each.position, each.attitude) for name, each in found.named().items()}
        with RunFolder(tum, force=force) as folder:
            for name, text in tum_files(found.reference, found.compared[0].errors.time, errors).items():
                folder.path(name).write_text(text, encoding="utf-8", newline="\n")
            folder.commit({"runs": [str(run) for run in runs]})
    if as_json:
        from insnav.report.save import json_ready

        result(json.dumps(json_ready(found.rows()), indent=1, ensure_ascii=False))
    else:
        result(brief_text(outcome))
