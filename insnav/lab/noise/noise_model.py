"""Noise coefficients from Allan deviations: significant noise types, their size and uncertainty.

``sigma^2 = 3 Q^2 / tau^2 + N^2 / tau + (2 ln 2 / pi) B^2 + K^2 tau / 3 + R^2 tau^2 / 2`` (IEEE Std 952-1997, annex C).
A first-order Gauss-Markov process may replace the bias instability B. Most bias models of filters and simulations are
such processes, whose Allan variance has a peak where B is flat. Sinusoidal noise is first removed from the samples
(`insnav.lab.noise.sinusoids`).

The variances at different times come from the same samples and are strongly correlated. Generalised least squares fits
the squares of the coefficients, with the covariance of the model itself (`insnav.lab.noise.allan`), repeated until both
agree. No square is negative.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar, nnls

from insnav.lab.noise.allan import AllanDeviation, chi_square_interval, covariance, freedom
from insnav.lab.noise.sinusoids import Sinusoid
from insnav.sample_statistics import CONFIDENCE, chi_square
from insnav.types import BoolArray, FloatArray, IntArray

NAMES = ("Q", "N", "B", "K", "GM", "R")  # Gauss-Markov before R: the first five are random
B_FACTOR = math.sqrt(2.0 * math.log(2.0) / math.pi)  # floor of the Allan deviation by B: 0.664
FITTED_PART = 6  # the fit ends at this part of the record: later variances have too few squares to be nearly Gaussian
PER_DECADE = 4  # points of the fit: more add nothing, as neighbours share samples
SIGNIFICANT = 6.63  # chi-square of one coefficient at 1 %
ROUNDS, FEW_ROUNDS = 4, 2
FEWEST_FREEDOM = 0.5  # fewer give no information
LARGEST_MISFIT = 1.0
NEGLIGIBLE = 1e-4  # negligible relative error of a variance
SINGULAR = 1e-4  # smallest eigenvalue of a correlation matrix beyond rounding
SHORTEST = 10.0  # least correlation time of a bias [samples]
TIMES_PER_DECADE = 5  # correlation times tried


@dataclass(frozen=True, slots=True)
class Coefficient:
    """One noise coefficient in SI units, or the standard deviation of a Gauss-Markov process."""

    value: float  # estimate
    sd: float  # its standard deviation
    low: float  # 95 % interval, by chi-square with the degrees of freedom of the standard deviation
    high: float


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """Noise of one axis."""

    coefficients: dict[str, Coefficient]  # of Q, N, B, K, GM, R: significant ones
    correlation_time: float  # of the Gauss-Markov process [s]; infinite without one
    correlation_time_sd: float  # its standard deviation [s]
    # relative standard deviation of the model error beyond the uncertainty of the Allan variances; zero without
    misfit: float
    variance: FloatArray  # (k,) Allan variance of the model at the times of the record
    freedom: FloatArray  # (k,) equivalent degrees of freedom of each estimate
    low: FloatArray  # (k,) 95 % intervals of the measured Allan deviations
    high: FloatArray
    sinusoids: tuple[Sinusoid, ...] = ()  # steady lines, strongest first; included in `variance`


@dataclass(frozen=True, slots=True)
class _Fit:
    """Model with its quality of fit."""

    squares: FloatArray  # (6,)
    time: float
    likelihood: float  # -2 ln, with the penalty of Akaike's criterion
    spread: FloatArray  # covariance of the squares that are not zero, then of ln(time)
    misfit: float


def basis(tau: FloatArray, correlation_time: float) -> FloatArray:
    """Compute the Allan variance of each noise of unit size.

    `tau` (k,): [s]. `correlation_time`: [s]. Returns (k, 6): for Q^2, N^2, B^2, K^2, the variance of the Gauss-Markov
    process, and R^2.
    """
    u = tau / correlation_time
    # (2 T / tau) (1 - T / (2 tau) (3 - 4 exp(-tau / T) + exp(-2 tau / T))), IEEE Std 952-1997, annex C; leading terms
    # where it cancels
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = (2.0 * u - 3.0 + 4.0 * np.exp(-u) - np.exp(-2.0 * u)) / u**2
    markov = np.where(u < 1e-3, 2.0 / 3.0 * u * (1.0 - 0.75 * u), exact)
    return np.column_stack([3.0 / tau**2, 1.0 / tau, np.full(tau.size, B_FACTOR**2), tau / 3.0, markov, 0.5 * tau**2])


def fit_noise(allan: AllanDeviation, column: int = 0) -> NoiseModel:
    """Fit the noise coefficients of one axis.

    `allan`: from `insnav.lab.noise.allan.allan_deviation`; the column must not be all zero. Akaike's criterion chooses
    between a floor B and a Gauss-Markov process. Then every term is dropped that lowers chi-square by less than 6.63
    (significant at 1 %).
    """
    rows = _chosen(allan)
    floor, markov = (_Fitter(allan, column, rows).fit(np.array([n != out for n in NAMES])) for out in ("GM", "B"))
    # a bump needs significant improvement for its two parameters over a flat floor or a walk
    best = markov if markov.likelihood + SIGNIFICANT < floor.likelihood else floor
    time = best.time
    sd = math.sqrt(best.spread[-1, -1]) * time if math.isfinite(time) else 0.0
    nothing = np.empty(0)
    model = NoiseModel(_coefficients(best), time, sd, best.misfit, nothing, nothing, nothing, nothing)
    return evaluated(model, allan, column)


def evaluated(model: NoiseModel, allan: AllanDeviation, column: int) -> NoiseModel:
    """Evaluate a model at the averaging times of a record, with the intervals of the deviations there.

    `allan`: of the record the model is of, at any times. `column`: which axis.
    """
    squares = np.array([model.coefficients[n].value ** 2 if n in model.coefficients else 0.0 for n in NAMES])
    time = model.correlation_time
    variance = basis(allan.tau, time if math.isfinite(time) else 1.0) @ squares
    spread = np.diag(covariance(allan.factors, allan.n, allan.interval, squares[:5], time, diagonal=True)).copy()
    for line in model.sinusoids:  # each is as uncertain as its amplitude
        lines = line.variance(allan.tau, allan.interval)
        variance = variance + lines
        spread += (2.0 * line.amplitude_sd / line.amplitude * lines) ** 2
    degrees = np.maximum(freedom(variance, spread), FEWEST_FREEDOM)
    low, high = chi_square_interval(allan.deviation[:, column], degrees, CONFIDENCE)
    return replace(model, variance=variance, freedom=degrees, low=low, high=high)


def _coefficients(fit: _Fit) -> dict[str, Coefficient]:
    found = {}
    for place, index in enumerate(np.flatnonzero(fit.squares)):
        value, variance = float(fit.squares[index]), float(fit.spread[place, place])
        root = math.sqrt(value)
        low, high = chi_square_interval(root, 2.0 * value**2 / variance, CONFIDENCE)
        found[NAMES[index]] = Coefficient(root, 0.5 * math.sqrt(variance) / root, float(low), float(high))
    return found


def _chosen(allan: AllanDeviation) -> IntArray:
    """Rows for the fit: about `PER_DECADE` evenly on the logarithmic axis, both ends included."""
    tau = allan.tau[allan.factors * FITTED_PART <= allan.n]
    count = max(4, 1 + round(PER_DECADE * math.log10(tau[-1] / tau[0])))
    wanted = np.geomspace(tau[0], tau[-1], count)
    return np.unique([int(np.argmin(np.abs(np.log(tau / each)))) for each in wanted])


@dataclass(frozen=True, slots=True)
class Weights:
    """Inverse of a root of a covariance, and the logarithm of its determinant."""

    inverse: FloatArray
    logarithm: float

    @classmethod
    def of(cls, own: FloatArray, misfit: FloatArray) -> Weights:
        """Compute weights from a covariance and the standard deviations of a misfit."""
        size = np.sqrt(np.diag(own) + misfit**2)
        value, vector = np.linalg.eigh((own + np.diag(misfit**2)) / np.outer(size, size))
        value = np.maximum(value, SINGULAR)  # remainder of rounding and quadrature
        # any root is valid: here from the eigenvectors
        return cls((vector / np.sqrt(value)).T / size, float(np.log(value).sum() + 2.0 * np.log(size).sum()))

    def chi(self, left: FloatArray) -> float:
        """Compute chi-square of residuals."""
        return float(np.sum((self.inverse @ left) ** 2))

    def likelihood(self, seen: FloatArray, model: FloatArray) -> float:
        """Compute minus twice the log-likelihood, up to a constant."""
        return self.chi(seen - model) + self.logarithm


class _Fitter:
    """Generalised least squares on the chosen times of one axis."""

    def __init__(self, allan: AllanDeviation, column: int, rows: IntArray) -> None:
        self.allan = allan
        self.tau, self.factors = allan.tau[rows], allan.factors[rows]
        self.size = float(np.max(allan.deviation[rows, column])) ** 2  # everything is fitted in this unit
        self.seen = allan.deviation[rows, column] ** 2 / self.size
        times = max(2, math.ceil(TIMES_PER_DECADE * math.log10(self.tau[-1] / self.tau[0])))
        # A bump is seen only if its top, at 1.89 T, and more than it lie within the record. A short one is the
        # sensor's own filter, no bias.
        self.times = np.geomspace(
            SHORTEST * allan.interval, max(self.tau[-1] / 3.0, 2.0 * SHORTEST * allan.interval), times
        )
        self.misfit = 0.0

    def fit(self, allowed: BoolArray) -> _Fit:
        """Fit, estimate the misfit, drop insignificant terms."""
        squares, time = self._again(allowed, *self._start(allowed), ROUNDS)
        for _ in range(ROUNDS):  # the weights depend on the misfit, and the fit on the weights
            if not self._find_misfit(squares, time):
                break
            squares, time = self._again(allowed, squares, time, 1)
        while True:
            kept = squares > 0.0
            full = self._weights(squares, time).likelihood(self.seen, self._basis(time) @ squares)
            fewer = []
            for index in np.flatnonzero(kept):
                without = kept.copy()
                without[index] = False
                if without.any():
                    found = self._again(without, *self._solve(without, self._weights(squares, time), time), FEW_ROUNDS)
                    gain = self._weights(*found).likelihood(self.seen, self._basis(found[1]) @ found[0]) - full
                    fewer.append((gain, found))
            gain, found = min(fewer, key=lambda each: each[0], default=(math.inf, (squares, time)))
            if not gain < SIGNIFICANT:
                break
            squares, time = self._again(found[0] > 0.0, *found, ROUNDS)
        return self._result(squares, time if squares[4] > 0.0 else math.inf)

    def _again(self, allowed: BoolArray, squares: FloatArray, time: float, rounds: int) -> tuple[FloatArray, float]:
        """Repeat the fit with the weights of the previous fit."""
        for _ in range(rounds):
            squares, time = self._solve(allowed, self._weights(squares, time), time)
        return squares, time

    def _find_misfit(self, squares: FloatArray, time: float) -> bool:
        """Set the misfit that gives the expected chi-square; return whether it is positive."""
        spare = self.tau.size - np.count_nonzero(squares) - (squares[4] > 0.0)
        own, model = self._own(squares, time), self._basis(time) @ squares

        def excess(misfit: float) -> float:
            return Weights.of(own, misfit * model).chi(self.seen - model) - float(spare)

        if spare <= 0 or (self.misfit == 0.0 and excess(0.0) + spare < chi_square(spare, 0.99)):
            return False
        if excess(LARGEST_MISFIT) > 0.0:
            self.misfit = LARGEST_MISFIT
        else:
            self.misfit = 0.0 if excess(0.0) <= 0.0 else float(brentq(excess, 0.0, LARGEST_MISFIT, xtol=1e-3))
        return True

    def _result(self, squares: FloatArray, time: float) -> _Fit:
        weights = self._weights(squares, time)
        columns = self._basis(time)[:, squares > 0.0]
        if squares[4] > 0.0:  # and the derivative of the curve by the logarithm of the correlation time
            step = 1e-3
            slope = (self._basis(time * (1 + step)) - self._basis(time * (1 - step)))[:, 4] / (2.0 * step) * squares[4]
            columns = np.column_stack([columns, slope])
        white = weights.inverse @ columns
        scale = np.linalg.norm(white, axis=0)
        spread = np.linalg.pinv((white / scale).T @ (white / scale)) / np.outer(scale, scale)
        units = np.full(columns.shape[1], self.size)
        if squares[4] > 0.0:
            units[-1] = 1.0
        count = columns.shape[1]
        likelihood = weights.likelihood(self.seen, self._basis(time) @ squares) + 2.0 * count
        return _Fit(squares * self.size, time, likelihood, spread * np.outer(units, units), self.misfit)

    def _basis(self, time: float) -> FloatArray:
        return basis(self.tau, time if math.isfinite(time) else 1.0)

    def _start(self, allowed: BoolArray) -> tuple[FloatArray, float]:
        """Fit with errors as large as the values, so that every part of the curve has weight."""
        middle = float(self.times[self.times.size // 2])
        return self._solve(allowed, Weights(np.diag(1.0 / self.seen), 0.0), middle)

    def _own(self, squares: FloatArray, time: float) -> FloatArray:
        """Compute the covariance of the measured variances under the model."""
        own = covariance(self.factors, self.allan.n, self.allan.interval, squares[:5], time)
        each = self._basis(time) * squares
        model = each.sum(axis=1)
        # Noise resembles a ramp by the difference between the means of both halves of the record: a common error at all
        # times.
        half = 0.5 * self.allan.n * self.allan.interval
        random = float((basis(np.array([half]), time if math.isfinite(time) else 1.0)[0] * squares)[:5].sum())
        slope = math.sqrt(2.0 * squares[5] * random) / half * self.tau**2
        own += np.outer(slope, slope)
        return np.asarray(own + np.diag((NEGLIGIBLE * model) ** 2))

    def _weights(self, squares: FloatArray, time: float) -> Weights:
        return Weights.of(self._own(squares, time), self.misfit * (self._basis(time) @ squares))

    def _solve(self, allowed: BoolArray, weights: Weights, time: float) -> tuple[FloatArray, float]:
        """Squares, none negative, and correlation time of least chi-square."""
        seen = weights.inverse @ self.seen

        def at(time: float) -> tuple[float, FloatArray]:
            white = weights.inverse @ self._basis(time)[:, allowed]
            scale = np.linalg.norm(white, axis=0)
            part, left = nnls(white / scale, seen)
            squares = np.zeros(6)
            squares[allowed] = part / scale
            return left, squares

        if not allowed[4]:
            return at(1.0)[1], math.inf
        tried = [at(each) for each in self.times]
        best = int(np.argmin([left for left, _ in tried]))
        low, high = self.times[max(0, best - 1)], self.times[min(best + 1, self.times.size - 1)]
        least = minimize_scalar(
            lambda logarithm: at(math.exp(logarithm))[0],
            bounds=(math.log(low), math.log(high)),
            method="bounded",
            options={"xatol": 1e-4},
        )
        time = math.exp(float(least.x))
        return at(time)[1], time
