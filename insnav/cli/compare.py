"""``insnav compare``: accuracy of runs against a reference, side by side."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from insnav.cli import options as opt
from insnav.cli.console import result
from insnav.cli.data_options import Data, takes_data

SHORT_HELP = "Accuracy of several runs against one reference, side by side."
HELP = """Accuracy of several runs against one reference, side by side.

Every run has a row for the filter's solution and one for the smoothed solution, if it has that. Only epochs of the
reference that every run covers are counted, so that the rows can be compared.

\b
Examples:
  insnav compare run1 run2 --ref ref.csv
  insnav compare run1 --ref rtk.csv --ref-lever-arm 0.8,-0.3,-1.2
  insnav compare run1 --ref ref.csv --tum tum   # files for evo_ape
  insnav compare run1 run2 --ref ref.csv --json | jq '.[].accuracy'
"""


@takes_data(None, files={"ref": True}, only=("ref_lever_arm", "ref_columns"))
def compare(
    data: Data,
    runs: Annotated[list[Path], typer.Argument(metavar="RUN", help="Run folders.", rich_help_panel=opt.FILES)],
    tum: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Also write the compared epochs for evo: a .tum file of each run, and of the reference.",
            rich_help_panel=opt.RESULT,
        ),
    ] = None,
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Compare runs."""
    from insnav.errors.comparison import compare as table
    from insnav.errors.comparison import named_errors
    from insnav.report.comparison import comparison_lines
    from insnav.report.run_json import json_ready
    from insnav.session.checked_inputs import checked, vector
    from insnav.session.read import read_ref

    assert data.ref is not None
    inputs = checked(data.inputs)
    lever_b, truth = vector(inputs, "ref_lever_arm"), read_ref(data.ref, inputs).data
    rows = table(runs, truth, lever_b=lever_b)
    if tum is not None:
        from insnav.output.folder import RunFolder
        from insnav.output.tum import tum_files

        with RunFolder(tum, force=force) as folder:
            errors = named_errors(runs, truth, lever_b)
            time = next(iter(errors.values())).time
            for name, text in tum_files(truth, time, {k: (e.position, e.attitude) for k, e in errors.items()}).items():
                folder.path(name).write_text(text, encoding="utf-8", newline="\n")
            folder.commit({"runs": [str(run) for run in runs]})
    if as_json:
        result(json.dumps(json_ready(rows), indent=1, ensure_ascii=False))
    else:
        result("\n".join(comparison_lines(rows)))
