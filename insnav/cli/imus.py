"""``insnav imus``: real IMUs by name, with the sources of their figures."""

from __future__ import annotations

import json
from typing import Annotated

from insnav.cli.console import result
from insnav.cli.options import IMU, RESULT, argument, flag
from insnav.exceptions import ConfigError

HELP = """Real IMUs by name, every figure with its source.

Without a name all of them in a table; with one, every figure of that part, the
document it stands in and what it is read as. What no document says is missing.

\b
Examples:
  insnav imus
  insnav imus STIM300
  insnav imus --json | jq '.imus[].part'
  insnav run drive.csv --gps gps.csv --imu STIM300
  insnav require --error "5 m" --after "30 s" --profile city
"""


def imus(
    name: Annotated[str | None, argument("PART", "A part, in any spelling. [all]", IMU)] = None,
    as_json: Annotated[bool, flag(RESULT, "--json", "Print JSON.")] = False,
) -> None:
    """List real IMUs, or show one."""
    from insnav.imu.library import close_names, find_part, parts
    from insnav.report.imus.page import part_page, parts_page
    from insnav.report.run_json import page_facts
    from insnav.report.terminal import page_text

    part = None if name is None else find_part(name)
    if name is not None and part is None:
        raise ConfigError(f"{name[:200]!r} is no part", where="PART", fix=f"known: {close_names(name)}")
    page = parts_page(parts()) if part is None else part_page(part)
    result(json.dumps(page_facts(page), indent=2, ensure_ascii=False) if as_json else page_text(page))
