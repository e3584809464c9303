"""Inverse error budget: the IMU quality that a limit on the position error requires."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, TypedDict, Unpack

import numpy as np

from insnav.config_file import parse_quantity
from insnav.engine import Workers
from insnav.errors.budget.sources import REST, first_movement, sampled
from insnav.errors.requirement import study as studies
from insnav.errors.requirement.allocation import Component, Requirement, allocate
from insnav.errors.requirement.study import RequirementStudy, Verified
from insnav.exceptions import ConfigError
from insnav.findings import Code, Finding
from insnav.imu import ImuSpec, load_imu
from insnav.imu.library import completed, find_part, parts
from insnav.result import Result
from insnav.session.budget import LONGEST_FREE
from insnav.simulate.motion import load_profile
from insnav.simulate.recording import MOTION_STREAM
from insnav.simulate.truth import Truth, straight
from insnav.steps.given import one_of

BEFORE = 300.0  # time with GPS before the outage, if the motion is long enough [s]
OUTAGES = 5  # number of outages, spread over a motion
LEAST_BEFORE = 60.0  # time with GPS between first movement and first outage [s]
LONGEST_PARTS = 600.0  # longest outage for which real IMUs are evaluated [s]


@dataclass(frozen=True, slots=True)
class RequirementSettings:
    """Settings of a requirement on an IMU, see `require`."""

    probability: float = 0.95  # required probability that the error is within the limit
    component: Component = "horizontal"  # component of the position error
    begin: float | None = None  # end of GPS after the start of the motion [s]; None: after `BEFORE`
    cost: Mapping[str, float] | None = None  # weight of each error family in the allocation; 1 by default
    runs: int = 500  # simulated runs that verify the allocated errors; 0: none
    seed: int = 1  # random seed


class RequirementOptions(TypedDict, total=False):
    """Settings of a requirement by name, see `RequirementSettings`."""

    probability: float
    component: Component
    begin: float | None
    cost: Mapping[str, float] | None
    runs: int
    seed: int


@dataclass(frozen=True, slots=True)
class Moving:
    """Motion on which an IMU must meet a requirement."""

    truth: Truth
    description: str
    moves: bool = True  # False for a motion at rest


def require(
    error: str | float,
    after: str | float,
    *,
    profile: str | None = None,
    imu: str | ImuSpec | None = None,
    workers: Workers = 1,
    progress: Callable[[float], None] | None = None,
    **options: Unpack[RequirementOptions],
) -> Result[RequirementStudy]:
    """Find the IMU quality that a limit on the position error requires.

    Parameters
    ----------
    error : str or float
        Limit of the position error, ``"5 m"``, or in [m].
    after : str or float
        Time without GPS, ``"30 s"``, or in [s].
    profile : str, optional
        Motion: name or file of a profile; at rest by default.
    imu : str or ImuSpec, optional
        IMU with given errors; the other errors are allocated.
    workers : int or str
        Processes, or an engine: ``processes:4``, ``dask:ADDRESS``.
    progress : callable, optional
        Called with the completed fraction of the simulated runs.
    **options
        Any of `RequirementSettings` by name, such as ``probability=0.99``.

    Returns
    -------
    Result of RequirementStudy

    Raises
    ------
    ConfigError
        Invalid requirement, motion or IMU.

    Examples
    --------
    >>> insnav.require("5 m", "30 s", profile="city").summary()  # doctest: +SKIP
    """
    settings = settings_of(options)
    required = requirement_of(error, after, settings)
    spec = load_imu(imu) if isinstance(imu, str) else imu
    return study_of(required, moving(profile, settings, required.after), spec, settings, workers, progress)


def settings_of(options: RequirementOptions) -> RequirementSettings:
    """Convert options by name to settings; unknown names are refused."""
    for name in options:
        one_of("require", name, tuple(RequirementOptions.__annotations__))
    return RequirementSettings(**options)


def requirement_of(error: str | float, after: str | float, settings: RequirementSettings) -> Requirement:
    """Build a requirement from limit `error` and time `after`, each a text with a unit or an SI value."""
    limit = parse_quantity(error, "length", where="--error") if isinstance(error, str) else float(error)
    time = parse_quantity(after, "time", where="--after") if isinstance(after, str) else float(after)
    return Requirement(limit, time, settings.probability, settings.component)


def moving(profile: str | None, settings: RequirementSettings, after: float) -> Moving:
    """Build the motion of a profile, or a motion at rest."""
    if profile is None:
        truth: Truth = straight(REST, 0.0, 0.0, BEFORE + max(after, LONGEST_FREE) + 1.0)
        return Moving(truth, "at rest, level, heading north, at a latitude of 45 deg", moves=False)
    chosen = load_profile(profile)
    return Moving(chosen.truth((settings.seed, MOTION_STREAM)), f"{chosen.name} ({chosen.purpose.rstrip('.')})")


def outage_begin(motion: Moving, after: float, begin: float | None) -> float:
    """Return the end of GPS after the start of a motion [s]: as specified, or after up to `BEFORE`.

    Raises: ConfigError: the motion is too short.
    """
    duration, longest = motion.truth.duration, motion.truth.duration - after
    if longest < 0.0 or (begin is not None and not 0.0 <= begin <= longest + 1e-6):
        where, begin_s = ("--after", np.nan) if begin is None else ("--begin", begin)
        raise ConfigError("require.motion_too_short", where=where, after_s=after, begin_s=begin_s, duration_s=duration)
    return begin if begin is not None else min(max(BEFORE, first_movement(motion.truth)), longest)


def study_of(
    required: Requirement,
    motion: Moving,
    given: ImuSpec | None,
    settings: RequirementSettings,
    workers: Workers = 1,
    progress: Callable[[float], None] | None = None,
) -> Result[RequirementStudy]:
    """Allocate the errors that a requirement permits on a motion, verify them, and compare real IMUs."""
    begin = outage_begin(motion, required.after, settings.begin)
    window = sampled(motion.truth, begin, required.after, f"{motion.description}, GPS ends at {begin:g} s")
    hold = required.after > LONGEST_FREE  # constrain the vertical channel before it becomes unstable
    if hold and required.component != "horizontal":
        raise ConfigError("require.vertical_unstable", where="--component", limit_s=LONGEST_FREE)
    found = allocate(required, window, given=given, cost=settings.cost, hold=hold)
    verified: tuple[Verified, ...] = ()
    if settings.runs and found.feasible:
        options: Any = {"hold": hold, "workers": workers, "progress": progress}
        verified = tuple(
            studies.verify(required, found.spec, window, settings.runs, settings.seed, factor=factor, **options)
            for factor in (1.0, studies.LARGER)
        )
    study = RequirementStudy(required, window.description, "" if given is None else given.name, found, hold, verified)
    if required.after <= LONGEST_PARTS:
        study = with_parts(study, motion, outages(motion, required.after, begin, settings), given)
    model = None if given is None else (given, Finding.of(Code.IMU_MODEL_GIVEN))
    return Result("requirement", study, options={**asdict(required), **asdict(settings)}, imu_model=model)


def outages(motion: Moving, after: float, begin: float, settings: RequirementSettings) -> list[float]:
    """Return the ends of GPS for the comparison of IMUs [s]: as specified, or several over the motion."""
    first = first_movement(motion.truth) + LEAST_BEFORE
    last = motion.truth.duration - max(after, min(LONGEST_FREE, 0.5 * (motion.truth.duration - first)))
    if settings.begin is not None or not motion.moves or last <= first:
        return [begin]
    return [float(each) for each in np.floor(np.linspace(first, last, OUTAGES))]


def with_parts(
    study: RequirementStudy, motion: Moving, begins: Sequence[float], given: ImuSpec | None
) -> RequirementStudy:
    """Add real IMUs evaluated against a requirement, and remedies and dominant errors of an example IMU."""
    required = study.required
    propagated = studies.propagation(motion.truth, begins, max(required.after, LONGEST_FREE))
    candidates = studies.candidates(required, propagated, parts())
    failing = [each for each in candidates if each.alone.error > required.error]
    part = find_part((failing or candidates[-1:])[0].name if given is None else given.name)
    spec = given
    if part is not None and (given is None or given.name == part.name):
        spec, _ = completed(part, load_imu(part.grade))
    assert spec is not None
    remedies, elasticities = studies.remedies(required, propagated, spec, part)
    at_end, through = studies.aided_covariances(propagated, [spec])
    last = min(max(round(required.after), 1), propagated.length)
    shares = studies.start_shares(propagated, at_end[:, 0], through[:, 0], required.axes, last)
    study = replace(study, begins=propagated.begins, time=propagated.after, candidates=candidates, example=spec.name)
    return replace(study, remedies=remedies, elasticities=elasticities, shares=shares)
