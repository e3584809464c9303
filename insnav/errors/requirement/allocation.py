"""Allowed size of errors: each alone, and jointly with agreed shares of the limit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from insnav.errors.budget.covariance import covariance
from insnav.errors.budget.sampled_motion import SampledMotion
from insnav.errors.budget.sources import families, sources_of, term_of
from insnav.errors.requirement.limit import Requirement
from insnav.exceptions import ConfigError
from insnav.imu import ImuSpec, InitialSpec, SensorSpec
from insnav.imu.error_terms import SENSORS, terms_of
from insnav.types import FloatArray
from insnav.units import DEG, G0

TAU = 3600.0  # correlation time of an allocated in-run bias [s]
STEEP = 2.0 * DEG  # largest attitude error of the linear model [rad]
_INITIAL_UNITS = {"initial tilt": "deg", "initial heading": "deg", "initial velocity": "m/s"}
# families that share the limit, in the order of a report
FAMILIES = (*(term.family for sensor in SENSORS for term in terms_of(sensor) if term.datasheet), *_INITIAL_UNITS)


@dataclass(frozen=True, slots=True)
class Share:
    """Allowed size of a family of errors, alone and in the set."""

    family: str  # see `insnav.errors.budget.sources.Source.family`
    unit: str  # display unit
    alone: float  # one standard deviation that meets the limit alone, SI; infinite if the effect is negligible
    # one standard deviation in the set, SI; of the largest axis for a given IMU
    size: float
    part: float  # share of the variance of the set
    given: bool  # given by the IMU
    # limited by the linear model: the family has little effect on this motion
    capped: bool


@dataclass(frozen=True, slots=True)
class Allocation:
    """Sizes of all errors that together just meet the requirement."""

    shares: tuple[Share, ...]
    spec: ImuSpec  # the set
    given: float  # error from the given families alone [m]
    error: float  # error of the whole set by the covariance, at the probability [m]
    feasible: bool  # the given families leave a margin for the others


def unit_of(family: str) -> str:
    """Return the display unit of a family of errors."""
    return _INITIAL_UNITS[family] if family in _INITIAL_UNITS else term_of(family).unit


def spec_of(sizes: Mapping[str, float], base: ImuSpec | None = None) -> ImuSpec:
    """Build an IMU specification from sizes by family, SI, equal on all axes; other families from `base`."""
    base = base or ImuSpec("allocated set", SensorSpec(), SensorSpec())
    changed: dict[str, dict[str, object]] = {"initial": {}, "gyro": {}, "accel": {}}
    for family, size in sizes.items():
        group, _, term = family.partition(" ")
        key = term if group == "initial" else term_of(family).key
        changed[group][key] = size if group == "initial" else np.full(3, size)
        if key == "bias_instability":
            changed[group]["correlation_time"] = TAU
    initial = replace(base.initial or InitialSpec(), **changed["initial"])  # type: ignore[arg-type]
    gyro, accel = replace(base.gyro, **changed["gyro"]), replace(base.accel, **changed["accel"])
    return replace(base, gyro=gyro, accel=accel, initial=initial, absent=())


def family_covariances(
    spec: ImuSpec, motion: SampledMotion, after: float, *, hold: bool = False
) -> dict[str, FloatArray]:
    """Compute the covariance ``(9, 9)`` of each family alone after a time [s]."""
    sources = sources_of(spec)
    row = np.array([last_sample(motion, after)])
    parts = covariance(sources, motion, row, hold=hold)[0]
    return {
        name: np.asarray(parts[[source.family == name for source in sources]].sum(axis=0)) for name in families(sources)
    }


def last_sample(motion: SampledMotion, after: float) -> int:
    """Return the number of samples up to a time since the start of a motion [s]."""
    return int(np.searchsorted(motion.elapsed, after - 1e-6)) + 1


def largest(family: str, after: float) -> float:
    """Return the largest size of a family within the linear model, SI."""
    rate = STEEP / after
    caps = {
        "rate": rate,
        "angle random walk": STEEP / math.sqrt(after),
        "rate per acceleration": rate / G0,
        "ratio": 0.05,
        "angle": 0.05,
        "acceleration": 0.5 * G0,
        "velocity random walk": 1.0,
    }
    if family.startswith("initial"):
        return {"initial tilt": STEEP, "initial heading": 5.0 * DEG}.get(family, 100.0)
    return caps[term_of(family).dimension]


def allocate(
    required: Requirement,
    motion: SampledMotion,
    *,
    given: ImuSpec | None = None,
    cost: Mapping[str, float] | None = None,
    hold: bool = False,
) -> Allocation:
    """Allocate the limit to the families of errors that are not `given`.

    `cost`: weight of a family, default 1. `hold`: see `insnav.errors.budget.covariance.covariance`.

    Notes
    -----
    Family f of size s has the covariance ``s^2 U_f`` and the limit L_f alone. Sizes in the set are ``k w_f^(1/3) L_f``,
    where k makes the total covariance just meet the limit. This is the cheapest set if a family of x times L costs
    ``w / x``, the reciprocal cost model of tolerance allocation (Chase and Greenwood, "Design issues in mechanical
    tolerance analysis", Manufacturing Review 1 (1988) 50-59). Without weights shares are equal.
    """
    weights = {**dict.fromkeys(FAMILIES, 1.0), **(cost or {})}
    unknown = [name for name in weights if name not in FAMILIES or not weights[name] > 0.0]
    if unknown:
        raise ConfigError("require.unknown_family", where="--cost", value=unknown[0], known=tuple(FAMILIES))
    after = required.after
    units = family_covariances(spec_of(dict.fromkeys(FAMILIES, 1.0)), motion, after, hold=hold)
    own = {} if given is None else family_covariances(given, motion, after, hold=hold)
    fixed = sum(own.values(), np.zeros((9, 9)))
    caps = {name: largest(name, after) for name in FAMILIES}
    alone = {name: required.error / max(required.size(units[name]), 1e-300) for name in FAMILIES}
    free = [name for name in FAMILIES if name not in own]
    made = required.size(fixed)
    sizes, capped = _sizes(
        required, fixed, units, {name: weights[name] ** (1.0 / 3.0) * alone[name] for name in free}, caps
    )
    total = fixed + sum((size**2 * units[name] for name, size in sizes.items()), np.zeros((9, 9)))
    trace = float(sum(total[i, i] for i in required.axes))
    shares = []
    for name in (*FAMILIES, *(name for name in own if name not in FAMILIES)):
        covered = own[name] if name in own else sizes[name] ** 2 * units[name]
        share = float(sum(covered[i, i] for i in required.axes)) / trace if trace > 0.0 else 0.0
        size = sizes.get(name, 0.0)
        if given is not None and name in own:
            size = max(source.sd for source in sources_of(given) if source.family == name)
        limit = alone.get(name, math.inf)
        shares.append(Share(name, unit_of(name), limit, size, share, name in own, name in capped))
    return Allocation(tuple(shares), spec_of(sizes, given), made, required.size(total), made < required.error)


def _sizes(
    required: Requirement,
    fixed: FloatArray,
    units: Mapping[str, FloatArray],
    wanted: Mapping[str, float],
    caps: Mapping[str, float],
) -> tuple[dict[str, float], set[str]]:
    """Compute sizes proportional to `wanted` that just meet the requirement, apart from capped ones."""
    if required.size(fixed) >= required.error:
        return dict.fromkeys(wanted, 0.0), set()
    capped: set[str] = set()
    while True:
        open_ = [name for name in wanted if name not in capped]
        base = fixed + sum((caps[name] ** 2 * units[name] for name in capped), np.zeros((9, 9)))
        shape = sum((wanted[name] ** 2 * units[name] for name in open_), np.zeros((9, 9)))

        def excess(k: float, base: FloatArray = base, shape: FloatArray = shape) -> float:
            return required.size(base + k * k * shape) - required.error

        k = brentq(excess, 0.0, 2.0, xtol=1e-12) if open_ and excess(0.0) < 0.0 < excess(2.0) else 0.0
        over = {name for name in open_ if k * wanted[name] > caps[name]}
        if not over:
            return {name: caps[name] if name in capped else k * wanted[name] for name in wanted}, capped
        capped |= over
