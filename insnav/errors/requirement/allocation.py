"""Limit on a position error, and the allowed size of errors: each alone, or jointly with agreed shares of the limit."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.optimize import brentq
from scipy.special import betaincinv, erf

from insnav.errors.budget.predicted import covariance
from insnav.errors.budget.sources import SampledMotion, families, sources_of, term_of
from insnav.exceptions import ConfigError
from insnav.imu import ImuSpec, InitialSpec, SensorSpec
from insnav.imu.specification import SENSORS, terms_of
from insnav.sample_statistics import CONFIDENCE, chi_square
from insnav.types import FloatArray
from insnav.units import DEG, G0

Component = Literal["horizontal", "vertical", "3d"]
COMPONENTS: dict[Component, tuple[int, ...]] = {"horizontal": (0, 1), "vertical": (2,), "3d": (0, 1, 2)}
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(96)
_FAR = 8.0  # standard deviations beyond which the probability is negligible
TAU = 3600.0  # correlation time of an allocated in-run bias [s]
STEEP = 2.0 * DEG  # largest attitude error of the linear model [rad]
_INITIAL_UNITS = {"initial tilt": "deg", "initial heading": "deg", "initial velocity": "m/s"}
# families that share the limit, in the order of a report
FAMILIES = (*(term.family for sensor in SENSORS for term in terms_of(sensor) if term.datasheet), *_INITIAL_UNITS)


@dataclass(frozen=True, slots=True)
class Requirement:
    """Requirement that a position error is within a limit with a given probability."""

    error: float  # limit of the position error [m]
    after: float  # time without aiding [s]
    probability: float = 0.95
    component: Component = "horizontal"  # component of the position error

    def __post_init__(self) -> None:
        checks = (
            (0.0 < self.error <= 1e6, f"{self.error:g} m", "--error", "> 0, ≤ 1e6 m"),
            (0.5 <= self.after <= 3600.0, f"{self.after:g} s", "--after", "≥ 0.5 s, ≤ 3600 s"),
            (0.5 <= self.probability <= 0.999, f"{self.probability:g}", "--probability", "≥ 0.5, ≤ 0.999"),
            (self.component in COMPONENTS, str(self.component), "--component", ", ".join(COMPONENTS)),
        )
        for good, given, where, fix in checks:
            if not good:
                raise ConfigError("require.not_sensible", where=where, given=given, allowed=fix)

    @property
    def axes(self) -> tuple[int, ...]:
        """Relevant axes of North, East, Down."""
        return COMPONENTS[self.component]

    def size(self, covariance: FloatArray) -> float:
        """Compute the error limit of a covariance ``(9, 9)`` or ``(3, 3)`` at the required probability [m]."""
        chosen = np.asarray(covariance)[np.ix_(self.axes, self.axes)]
        return length_quantile(np.linalg.eigvalsh(chosen).astype(np.float64), self.probability)

    def sizes(self, covariances: FloatArray) -> FloatArray:
        """Compute `size` for many covariances ``(..., n, n)`` by a table, accurate to 1e-3."""
        chosen = np.asarray(covariances)[..., self.axes, :][..., :, self.axes]
        variances = np.maximum(np.linalg.eigvalsh(chosen)[..., ::-1], 0.0)
        sd = np.sqrt(np.maximum(variances, 1e-300))
        if len(self.axes) == 1:
            return np.asarray(sd[..., 0] * length_quantile(np.ones(1), self.probability))
        grid, table = _table(len(self.axes), self.probability)
        ratios = sd[..., 1:] / sd[..., :1]
        quantile = RegularGridInterpolator((grid,) * (len(self.axes) - 1), table, method="linear")(ratios)
        return np.asarray(sd[..., 0] * quantile)

    @property
    def text(self) -> str:
        """Requirement in words."""
        return (
            f"{self.component} error within {self.error:g} m after {self.after:g} s with probability "
            f"{self.probability:g}"
        )


def length_probability(variances: FloatArray, length: float) -> float:
    """Compute the probability that a Gaussian vector is not longer than `length`.

    `variances` (n,): along its principal axes, n up to 3. The axes are integrated in turn, ``P(l_1 z_1^2 + ... <=
    r^2)``, by Gauss-Legendre nodes in the angle t of ``z = z_max sin t``.
    """
    kept = np.sort(variances[variances > 1e-14 * max(float(np.max(variances)), 1e-300)])[::-1]
    return float(_inside(kept, np.array([length**2]))[0]) if len(kept) else 1.0


def _inside(variances: FloatArray, squares: FloatArray) -> FloatArray:
    if len(variances) == 1:
        return np.asarray(erf(np.sqrt(np.maximum(squares, 0.0) / (2.0 * variances[0]))))
    ends = np.minimum(np.sqrt(np.maximum(squares, 0.0) / variances[-1]), _FAR)[:, None]
    angle = 0.5 * np.pi * _NODES
    z = ends * np.sin(angle)
    rest = squares[:, None] - variances[-1] * z**2
    inner = _inside(variances[:-1], rest.ravel()).reshape(z.shape)
    density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi) * ends * np.cos(angle) * 0.5 * np.pi
    return np.asarray((inner * density) @ _WEIGHTS)


def length_quantile(variances: FloatArray, probability: float) -> float:
    """Compute the length that a Gaussian vector does not exceed with a probability; zero for zero variances.

    `variances` (n,): along its principal axes, n up to 3.
    """
    largest = float(np.max(variances))
    if largest <= 0.0:
        return 0.0
    scaled = np.maximum(variances, 0.0) / largest
    low, high = (np.sqrt(chi_square(n, probability)) for n in (1, len(scaled)))
    if high - low < 1e-12:
        return float(low * np.sqrt(largest))
    length = brentq(lambda r: length_probability(scaled, r) - probability, 0.99 * low, 1.01 * high, xtol=1e-10)
    return float(length * np.sqrt(largest))


@functools.cache
def _table(axes: int, probability: float) -> tuple[FloatArray, FloatArray]:
    """Tabulate the length quantile over the ratios of the smaller standard deviations to the largest, which is one."""
    grid = np.linspace(0.0, 1.0, 33 if axes == 2 else 17)
    ratios = np.stack(np.meshgrid(*(grid,) * (axes - 1), indexing="ij"), axis=-1).reshape(-1, axes - 1)
    quantiles = [length_quantile(np.append(1.0, ratio**2), probability) for ratio in ratios]
    return grid, np.array(quantiles).reshape((len(grid),) * (axes - 1))


def binomial_interval(count: int, of: int) -> tuple[float, float]:
    """Compute the 95 % interval of a probability, `count` of `of` (Clopper and Pearson, Biometrika 26 (1934) 404)."""
    tail = 0.5 * (1.0 - CONFIDENCE)
    low = float(betaincinv(count, of - count + 1, tail)) if count else 0.0
    high = float(betaincinv(count + 1, of - count, 1.0 - tail)) if count < of else 1.0
    return low, high


@dataclass(frozen=True, slots=True)
class Share:
    """Allowed size of a family of errors, alone and in the set."""

    family: str  # see `insnav.errors.budget.sources.Source.family`
    unit: str  # display unit
    alone: float  # one standard deviation that meets the limit alone, SI; infinite if the effect is negligible
    # one standard deviation in the set, SI; of the largest axis for a given IMU
    size: float
    part: float  # share of the variance of the set
    given: bool  # True if the IMU specifies this family
    capped: bool  # True if the linear model limits the size, as the family has little effect on this motion


@dataclass(frozen=True, slots=True)
class Allocation:
    """Sizes of all errors that together just meet the requirement."""

    shares: tuple[Share, ...]
    spec: ImuSpec  # IMU with these sizes
    given: float  # error from the given families alone [m]
    error: float  # error of the whole set by the covariance, at the probability [m]
    feasible: bool  # True if the given families leave a margin for the others


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
    parts = covariance(sources, motion, np.array([last_sample(motion, after)]), hold=hold)[0]
    return {
        name: np.asarray(parts[[source.family == name for source in sources]].sum(axis=0)) for name in families(sources)
    }


def last_sample(motion: SampledMotion, after: float) -> int:
    """Return the number of samples up to a time since the start of a motion [s]."""
    return int(np.searchsorted(motion.elapsed, after - 1e-6)) + 1


def largest(family: str, after: float) -> float:
    """Return the largest size of a family for which the linear model is valid, SI."""
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

    `cost`: weight of a family, default 1. `hold`: see `insnav.errors.budget.predicted.covariance`.

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
    of_given = {} if given is None else family_covariances(given, motion, after, hold=hold)
    fixed = sum(of_given.values(), np.zeros((9, 9)))
    caps = {name: largest(name, after) for name in FAMILIES}
    alone = {name: required.error / max(required.size(units[name]), 1e-300) for name in FAMILIES}
    free = [name for name in FAMILIES if name not in of_given]
    error = required.size(fixed)
    sizes, capped = _sizes(
        required, fixed, units, {name: weights[name] ** (1.0 / 3.0) * alone[name] for name in free}, caps
    )
    total = fixed + sum((size**2 * units[name] for name, size in sizes.items()), np.zeros((9, 9)))
    trace = float(sum(total[i, i] for i in required.axes))
    shares = []
    for name in (*FAMILIES, *(name for name in of_given if name not in FAMILIES)):
        contribution = of_given[name] if name in of_given else sizes[name] ** 2 * units[name]
        share = float(sum(contribution[i, i] for i in required.axes)) / trace if trace > 0.0 else 0.0
        size = sizes.get(name, 0.0)
        if given is not None and name in of_given:
            size = max(source.sd for source in sources_of(given) if source.family == name)
        limit = alone.get(name, math.inf)
        shares.append(Share(name, unit_of(name), limit, size, share, name in of_given, name in capped))
    return Allocation(tuple(shares), spec_of(sizes, given), error, required.size(total), error < required.error)


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
        uncapped = [name for name in wanted if name not in capped]
        base = fixed + sum((caps[name] ** 2 * units[name] for name in capped), np.zeros((9, 9)))
        shape = sum((wanted[name] ** 2 * units[name] for name in uncapped), np.zeros((9, 9)))

        def excess(k: float, base: FloatArray = base, shape: FloatArray = shape) -> float:
            return required.size(base + k * k * shape) - required.error

        k = brentq(excess, 0.0, 2.0, xtol=1e-12) if uncapped and excess(0.0) < 0.0 < excess(2.0) else 0.0
        exceeding = {name for name in uncapped if k * wanted[name] > caps[name]}
        if not exceeding:
            return {name: caps[name] if name in capped else k * wanted[name] for name in wanted}, capped
        capped |= exceeding
