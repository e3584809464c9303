"""Error budget of an IMU: along a motion, or in the windows of a recorded drive."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import TypedDict

from insnav.errors.budget import from_windows
from insnav.errors.budget.error_budget import Budget, budget, check_times
from insnav.errors.budget.sources import SampledMotion, Source, at_rest, first_movement, sampled
from insnav.exceptions import ConfigError
from insnav.findings import Code, Finding
from insnav.imu.specification import ImuSpec
from insnav.result import Result
from insnav.simulate.motion import load_profile
from insnav.simulate.recording import MOTION_STREAM

RUNS_BEYOND_LINEAR = 100  # simulated runs if no linear method applies and no runs were requested
LONGEST_FREE = 300.0  # longest time in which the vertical channel's instability is negligible [s]


@dataclass(frozen=True, slots=True)
class BudgetSettings:
    """Settings of an error budget."""

    times: Sequence[float] = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)  # times at which errors are reported [s]
    runs: int = 0  # number of simulated runs; 0: none
    seed: int = 1  # random seed
    deflection: float = 0.0  # deflection of the vertical outside the gravity model, 1 sd per axis [rad]
    hold: bool | None = None  # constrain the vertical channel to the reference; None: where it would become unstable

    def __post_init__(self) -> None:
        check_times(self.times)


class BudgetOptions(TypedDict, total=False):
    """Settings of an error budget by name, see `BudgetSettings`."""

    times: Sequence[float]
    runs: int
    seed: int
    deflection: float
    hold: bool | None


def motion_of(
    profile: str | None, begin: float | None, settings: BudgetSettings, rest: Mapping[str, float] | None = None
) -> SampledMotion:
    """Build the motion of a budget without a recorded drive: a part of a profile, or rest.

    `profile`: name or file of a profile. `begin`: start after the profile's start [s]; by default 1 s before it moves.
    `rest`: place, for `insnav.errors.budget.sources.at_rest`.
    Raises: ConfigError: a start without a profile, a place with a profile, or an unknown profile.
    """
    duration = max(settings.times)
    if profile is None:
        if begin is not None:
            raise ConfigError("session.begin_without_profile", where="--begin")
        return at_rest(duration, **(rest or {}))
    if rest:
        raise ConfigError("session.profile_has_place", where=f"--{next(iter(rest))}")
    chosen = load_profile(profile)
    truth = chosen.truth((settings.seed, MOTION_STREAM))
    start = first_movement(truth) if begin is None else begin
    return sampled(truth, start, duration, f"{chosen.name}, from {start:g} s on ({chosen.purpose.rstrip('.')})")


def budget_of_motion(
    spec: ImuSpec, motion: SampledMotion, settings: BudgetSettings, progress: Callable[[float], None] | None = None
) -> Result[from_windows.BudgetStudy]:
    """Compute the budget of an IMU on a motion.

    `progress`: called with the completed fraction of the simulated runs.
    """
    found = _drawn_up(spec, motion, settings, (), progress)
    model = spec, Finding.of(Code.IMU_MODEL_GIVEN)
    return Result("budget", from_windows.BudgetStudy(found), options=asdict(settings), imu_model=model)


def budget_of_windows(
    windows: from_windows.RecordedBudget, settings: BudgetSettings, progress: Callable[[float], None] | None = None
) -> from_windows.BudgetStudy:
    """Compute the budget of the typical window of a drive, and compare it with all windows."""
    spec, motion = from_windows.spec_in_windows(windows), from_windows.window_motion(windows, max(settings.times))
    found = _drawn_up(spec, motion, settings, from_windows.window_start_sources(windows), progress)
    return from_windows.BudgetStudy(from_windows.with_recorded(found, windows), windows)


def _drawn_up(
    spec: ImuSpec,
    motion: SampledMotion,
    settings: BudgetSettings,
    known: tuple[Source, ...],
    progress: Callable[[float], None] | None,
) -> Budget:
    """Compute a budget; add simulated runs if the errors exceed the linear model."""
    hold = max(settings.times) > LONGEST_FREE if settings.hold is None else settings.hold
    base = partial(budget, spec, motion, settings.times, seed=settings.seed, deflection=settings.deflection, hold=hold)
    with_known = partial(base, known=known, progress=progress)
    first = with_known(runs=settings.runs)
    return first if first.linear or settings.runs else with_known(runs=RUNS_BEYOND_LINEAR)
