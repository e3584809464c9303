"""All checks, one after the other, and what they amount to."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from insnav.certificate.check import Check
from insnav.certificate.coning_sculling import coning, sculling, spin, upright
from insnav.certificate.gravity import gravity
from insnav.certificate.integrators import Integrator, integrators
from insnav.certificate.navigation_checks import free_inertial, meridians, poles, rest, schuler
from insnav.certificate.platform_checks import platform
from insnav.certificate.static_day import day

# what every strapdown integrator is asked; other mechanizations and models answer for themselves in `OTHERS`
TOPICS: tuple[Callable[[Sequence[Integrator]], list[Check]], ...] = (
    coning,
    sculling,
    spin,
    upright,
    free_inertial,
    schuler,
    rest,
    day,
    meridians,
    poles,
)
OTHERS: tuple[Callable[[], list[Check]], ...] = (platform, gravity)


@dataclass(frozen=True, slots=True)
class Certificate:
    """Every check of one installation."""

    checks: tuple[Check, ...]
    seconds: float  # how long it took, compilation included [s]

    @property
    def failed(self) -> tuple[Check, ...]:
        """Checks whose error exceeds its limit."""
        return tuple(check for check in self.checks if not check.passed)


def certify(peers: Sequence[Integrator] = (), progress: Callable[[float], None] | None = None) -> Certificate:
    """Measure the integrators, the platform's too, and the gravity model of this installation against closed forms.

    Takes seconds. Integrators of other packages are compared with the own ones; `progress` gets the fraction done.
    """
    begin = time.perf_counter()
    asked = (*integrators(), *peers)
    topics: list[Callable[[], list[Check]]] = [*(partial(topic, asked) for topic in TOPICS), *OTHERS]
    checks: list[Check] = []
    for number, topic in enumerate(topics, start=1):
        checks += topic()
        if progress is not None:
            progress(number / len(topics))
    return Certificate(tuple(checks), time.perf_counter() - begin)
