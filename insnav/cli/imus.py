"""``insnav imus``: real IMUs by name, with the sources of their figures."""

from __future__ import annotations

import json
from typing import Annotated

from insnav.cli.console import result
from insnav.cli.options import IMU, RESULT, argument, flag
from insnav.exceptions import ConfigError


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
