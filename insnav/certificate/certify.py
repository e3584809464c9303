"""Certificate: all checks in order, and their summary."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

from insnav.certificate.integrators import Check, Integrator, integrators, pyins
from insnav.certificate.platform_checks import gravity
from insnav.certificate.platform_checks import platform as gimballed
from insnav.certificate.strapdown_checks import TOPICS
from insnav.findings import Code, Finding
from insnav.result import Result
from insnav.version import __version__

# checks of the platform and of the gravity model, which take no strapdown integrators
OTHERS: tuple[Callable[[], list[Check]], ...] = (gimballed, gravity)
_ABOUT_ALL = Code.CERTIFICATE_SAMPLES, Code.CERTIFICATE_INTEGRATORS, Code.CERTIFICATE_CONING
_ABOUT = {"fourth": Code.CERTIFICATE_PLATFORM, "pyins": Code.CERTIFICATE_PYINS}  # findings by name of an integrator


@dataclass(frozen=True, slots=True)
class Certificate:
    """Checks of one installation."""

    checks: tuple[Check, ...]
    seconds: float  # duration including compilation [s]
    machine: str = field(default_factory=lambda: f"{platform.system()} {platform.machine()}")
    version: str = __version__  # version of insnav

    @property
    def failed(self) -> tuple[Check, ...]:
        """Checks whose error exceeds its limit."""
        return tuple(check for check in self.checks if not check.passed)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Checks that failed, and the assumptions of the certificate."""
        named = dict.fromkeys(name for check in self.checks for name, _ in check.values)
        failed = (Finding.of(Code.CERTIFICATE_FAILED, subject=check.name) for check in self.failed)
        return (*failed, *map(Finding.of, (*_ABOUT_ALL, *(_ABOUT[name] for name in named if name in _ABOUT))))


def verify(*, peer: bool = False, progress: Callable[[float], None] | None = None) -> Result[Certificate]:
    """Test the numerics of this installation against closed forms and published values, in seconds.

    Parameters
    ----------
    peer : bool
        Compare with python-ins.
    progress : callable, optional
        Called with the completed fraction of the work.

    Returns
    -------
    Result of Certificate
        ``found.failed`` has the checks whose error exceeds its limit.

    Raises
    ------
    ConfigError
        python-ins is not installed.

    Examples
    --------
    >>> insnav.verify().found.failed  # doctest: +SKIP
    ()
    """
    found = certify((pyins(),) if peer else (), progress)
    return Result("certificate", found, options={"peer": peer}, findings=found.findings)


def certify(peers: Sequence[Integrator] = (), progress: Callable[[float], None] | None = None) -> Certificate:
    """Test the integrators, including the platform's, and the gravity model against closed forms.

    Takes seconds. `peers`: integrators of other packages, for comparison. `progress`: gets the completed fraction.
    """
    begin = time.perf_counter()
    compared = (*integrators(), *peers)
    topics: list[Callable[[], list[Check]]] = [*(partial(topic, compared) for topic in TOPICS), *OTHERS]
    checks: list[Check] = []
    for number, topic in enumerate(topics, start=1):
        checks += topic()
        if progress is not None:
            progress(number / len(topics))
    return Certificate(tuple(checks), time.perf_counter() - begin)
