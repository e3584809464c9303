"""``insnav imus``: real IMUs by name, with the sources of their figures."""

from __future__ import annotations

import json
from typing import Annotated

from insnav.cli.console import brief_text, result
from insnav.cli.options import IMU, RESULT, argument, flag


def imus(
    name: Annotated[str | None, argument("PART", "A part, in any spelling. [all]", IMU)] = None,
    as_json: Annotated[bool, flag(RESULT, "--json", "Print JSON.")] = False,
) -> None:
    """List real IMUs, or show one."""
    from insnav.report.save import facts_of
    from insnav.session.imus import imus as listed

    found = listed(name)
    result(json.dumps(facts_of(found), indent=2, ensure_ascii=False) if as_json else brief_text(found))
