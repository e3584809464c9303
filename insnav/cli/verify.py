"""``insnav verify``: numerical certificate of this installation."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from insnav.cli.console import note, result, result_page, working, write_result
from insnav.cli.options import RESULT, START, Force, Json, Out, flag
from insnav.exceptions import ConfigError


def verify(
    peer: Annotated[bool, flag(START, "--peer", "Compare with python-ins, if it is installed.")] = False,
    faults: Annotated[bool, flag(START, "--faults", "Print the fault matrix instead.")] = False,
    out: Out = Path("certificate"),
    force: Force = False,
    as_json: Json = False,
    markdown: Annotated[bool, flag(RESULT, "--markdown", "Print one Markdown table instead.")] = False,
) -> None:
    """Certify."""
    if as_json and markdown:
        raise ConfigError("cli.json_or_markdown", where="--json --markdown")
    if faults:
        _print_faults(as_json=as_json)
        return
    with working(out, force) as (folder, stage):
        stage("certifying")
        from insnav.certificate.certify import verify as verified

        outcome = verified(peer=peer, progress=lambda fraction: stage("certifying", fraction))
        where = write_result(outcome, folder, stage, figures="png")
    if markdown:
        from insnav.report.certificate.page import certificate_markdown

        result(certificate_markdown(outcome.found))
    else:
        result_page(where, outcome.page(), out, as_json=as_json)
    if failed := outcome.found.failed:
        note(f"{len(failed)} of {len(outcome.found.checks)} checks failed")
        raise typer.Exit(1)


def _print_faults(*, as_json: bool) -> None:
    from insnav.certificate.faults import fault_matrix, matrix_lines

    rows = fault_matrix()
    result(json.dumps([asdict(row) for row in rows], indent=1) if as_json else "\n".join(matrix_lines(rows)))
