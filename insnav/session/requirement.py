"""The error budget backwards: which IMU is needed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import TypedDict, Unpack

from insnav.errors.budget.sampled_motion import REST, first_movement, sampled
from insnav.errors.requirement.allocation import allocate
from insnav.errors.requirement.limit import Component, Requirement
from insnav.errors.requirement.study import RequirementStudy
from insnav.errors.requirement.verification import LARGER, Verified, verify
from insnav.exceptions import ConfigError
from insnav.imu import ImuSpec, load_imu
from insnav.result import Result
from insnav.session.budget import LONGEST_FREE
from insnav.session.checked_inputs import one_of
from insnav.simulate.closed_forms import straight
from insnav.simulate.motion import load_profile
from insnav.simulate.recording import MOTION_STREAM
from insnav.simulate.truth import Truth
from insnav.units import parse_quantity

BEFORE = 300.0  # GPS before the outage, where the motion is long enough [s]


@dataclass(frozen=True, slots=True)
class RequirementSettings:
    """How a requirement is worked out."""

    probability: float = 0.95  # of being within the limit
    component: Component = "horizontal"  # which part of the position error
    begin: float | None = None  # when GPS ends, after the start of the motion [s]; None: after `BEFORE` of it
    cost: Mapping[str, float] | None = None  # weight of a family of errors in the set, 1 where none is given
    runs: int = 500  # simulated runs that verify the set; none with zero
    seed: int = 1  # random seed


class RequirementOptions(TypedDict, total=False):
    """`RequirementSettings` by name."""

    probability: float
    component: Component
    begin: float | None
    cost: Mapping[str, float] | None
    runs: int
    seed: int


@dataclass(frozen=True, slots=True)
class Moving:
    """A motion that a requirement is for."""

    truth: Truth
    description: str


def require(
    error: str | float,
    after: str | float,
    *,
    profile: str | None = None,
    imu: str | ImuSpec | None = None,
    progress: Callable[[float], None] | None = None,
    **options: Unpack[RequirementOptions],
) -> Result[RequirementStudy]:
    """Find out how good an IMU must be for a limit on the position error.

    Parameters
    ----------
    error : str or float
        Limit of the position error, ``"5 m"``, or in [m].
    after : str or float
        Time without GPS, ``"30 s"``, or in [s].
    profile : str, optional
        Motion: name or file of a profile; at rest by default.
    imu : str or ImuSpec, optional
        IMU whose errors are given; only the others are allocated.
    progress : callable, optional
        Called with the fraction of the simulated runs that is done.
    **options
        Any of `RequirementSettings` by name, such as ``probability=0.99``.

    Returns
    -------
    Result of RequirementStudy

    Raises
    ------
    ConfigError
        A requirement, motion or IMU that makes no sense.

    Examples
    --------
    >>> insnav.require("5 m", "30 s", profile="city").summary()  # doctest: +SKIP
    """
    settings = settings_of(options)
    required = requirement_of(error, after, settings)
    spec = load_imu(imu) if isinstance(imu, str) else imu
    return study_of(required, moving(profile, settings, required.after), spec, settings, progress)


def settings_of(options: RequirementOptions) -> RequirementSettings:
    """Settings of options by name, unknown ones refused."""
    for name in options:
        one_of("require", name, tuple(RequirementOptions.__annotations__))
    return RequirementSettings(**options)


def requirement_of(error: str | float, after: str | float, settings: RequirementSettings) -> Requirement:
    """Requirement of a limit and a time, texts with units or SI."""
    limit = parse_quantity(error, "length", where="--error") if isinstance(error, str) else float(error)
    time = parse_quantity(after, "time", where="--after") if isinstance(after, str) else float(after)
    return Requirement(limit, time, settings.probability, settings.component)


def moving(profile: str | None, settings: RequirementSettings, after: float) -> Moving:
    """Motion of a profile, or rest."""
    if profile is None:
        truth: Truth = straight(REST, 0.0, 0.0, BEFORE + after + 1.0)
        return Moving(truth, "at rest, level, heading north, at a latitude of 45 deg")
    chosen = load_profile(profile)
    return Moving(chosen.truth((settings.seed, MOTION_STREAM)), f"{chosen.name} ({chosen.purpose.rstrip('.')})")


def outage_begin(motion: Moving, after: float, begin: float | None) -> float:
    """When GPS ends, since the start of a motion [s]: as given, or after `BEFORE` of it, as far as it is long enough.

    Raises: ConfigError: the motion is too short.
    """
    longest = motion.truth.duration - after
    if longest < 0.0 or (begin is not None and not 0.0 <= begin <= longest + 1e-6):
        raise ConfigError(
            f"the motion is not long enough for {after:g} s" + ("" if begin is None else f" from {begin:g} s on"),
            where="--after" if begin is None else "--begin",
            why=f"it lasts {motion.truth.duration:.1f} s",
            fix="choose a shorter time, an earlier --begin, or a longer profile",
        )
    return begin if begin is not None else min(max(BEFORE, first_movement(motion.truth)), longest)


def study_of(
    required: Requirement,
    motion: Moving,
    given: ImuSpec | None,
    settings: RequirementSettings,
    progress: Callable[[float], None] | None = None,
) -> Result[RequirementStudy]:
    """Work out a requirement on a motion."""
    begin = outage_begin(motion, required.after, settings.begin)
    window = sampled(motion.truth, begin, required.after, f"{motion.description}, GPS ends at {begin:g} s")
    hold = required.after > LONGEST_FREE
    if hold and required.component != "horizontal":
        raise ConfigError(
            f"the vertical channel is unstable beyond {LONGEST_FREE:g} s", where="--component", fix="use horizontal"
        )
    found = allocate(required, window, given=given, cost=settings.cost, hold=hold)
    verified: tuple[Verified, ...] = ()
    if settings.runs and found.feasible:
        verified = tuple(
            verify(
                required, found.spec, window, settings.runs, settings.seed, factor=factor, hold=hold, progress=progress
            )
            for factor in (1.0, LARGER)
        )
    study = RequirementStudy(required, window.description, "" if given is None else given.name, found, hold, verified)
    model = None if given is None else (given, "given")
    return Result("requirement", study, options={**asdict(required), **asdict(settings)}, imu_model=model)
