"""``insnav imus``: real IMUs by name, with the sources of their figures."""

from __future__ import annotations

import json
from typing import Annotated

from insnav.cli.console import result
from insnav.cli.options import IMU, RESULT, argument, flag


def imus(
    name: Annotated[str | None, argument("PART", "A part, in any spelling. [all]", IMU)] = None,
    as_json: Annotated[bool, flag(RESULT, "--json", "Print JSON.")] = False,
) -> None:
    """List real IMUs, or show one."""
    from insnav.report.imus.page import page
    from insnav.report.run_json import page_facts
    from insnav.report.terminal import page_text
    from insnav.session.imus import imus as listed

    shown = page(listed(name))
    result(json.dumps(page_facts(shown), indent=2, ensure_ascii=False) if as_json else page_text(shown))
