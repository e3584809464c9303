"""Sinusoidal noise (vibration, mains, a control loop): lines in the spectrum of a record at rest.

``sigma^2(tau) = W0^2 (sin^2(pi f0 tau) / (pi f0 tau))^2`` (IEEE Std 952-1997, annex C, sinusoidal noise), with
amplitude W0. With samples every dt, ``pi f0 tau`` in the denominator becomes ``m sin(pi f0 dt)``, tau = m dt. This is
equal far below the sampling rate, and exact near half of it.

A few points of an Allan deviation hardly determine a frequency, so the lines come from the spectrum (Hann window). A
line is a bin that the surrounding noise would exceed in a share `FALSE_ALARM` of records. It is a steady sinusoid only
if neighbouring bins have the shape of the window. Otherwise it is vibration of changing frequency, without coefficient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.fft import prev_fast_len, rfft
from scipy.signal import detrend
from scipy.signal.windows import hann

from insnav.types import FloatArray

MOST = 8  # lines of one signal
FALSE_ALARM = 1e-4  # share of pure noise records with a line
FEWEST_CYCLES = 50  # in the record: drift dominates below
FEWEST_SAMPLES = 1000
LONGEST = 1 << 24  # samples: every part of a longer record contains a steady line
NEAR, BAND_STEP = 1.25, 1.05  # median power up to this factor in frequency, at such steps
MOST_OF_BAND = 2000  # bins of such a median
MAIN_LOBE = 3  # bins on each side of a line that reveal its shape
REST = 0.1  # largest remaining share of a line's power after the shape
WIDE = 4096  # bins on each side corrected for a line
FAINT = 1e-6  # relative power that may be rounding of the strongest line
SEEN = 0.05  # least share of a line in some Allan variance: smaller lines change no coefficient


@dataclass(frozen=True, slots=True)
class Sinusoid:
    """One line."""

    frequency: float  # f0 [Hz]
    frequency_sd: float  # its standard deviation [Hz]
    amplitude: float  # W0 [unit of the signal]
    amplitude_sd: float  # its standard deviation [unit of the signal]
    phase: float  # at the first sample, of a cosine [rad]

    def at(self, time: FloatArray) -> FloatArray:
        """Evaluate the line; time (n,): since the first sample [s]. Returns (n,)."""
        return np.asarray(self.amplitude * np.cos(2.0 * np.pi * self.frequency * time + self.phase))

    def variance(self, tau: FloatArray, interval: float) -> FloatArray:
        """Compute the Allan variance of the line, (k,), at averaging times tau (k,) [s] and sampling interval [s]."""
        slow = tau / interval * math.sin(math.pi * self.frequency * interval)
        return np.asarray((self.amplitude * np.sin(np.pi * self.frequency * tau) ** 2 / slow) ** 2)


def find_sinusoids(values: FloatArray, interval: float) -> tuple[Sinusoid, ...]:
    """Find steady lines, strongest first.

    `values` (n,): signal at even steps, not constant. `interval`: step [s].
    """
    n = prev_fast_len(min(values.size, LONGEST), real=True)
    if n < FEWEST_SAMPLES:
        return ()
    straight, window = detrend(values[:n]), hann(n, sym=False)
    spectrum = rfft(straight * window)
    around = _around(np.abs(spectrum) ** 2)
    bins = np.arange(spectrum.size)
    free = (bins >= FEWEST_CYCLES) & (bins < spectrum.size - 1 - MAIN_LOBE) & (around > 0.0)
    limit = -math.log(FALSE_ALARM / max(int(np.count_nonzero(free)), 1))
    found: list[Sinusoid] = []
    strongest = 0.0
    for _ in range(4 * MOST):
        power = np.where(free, np.abs(spectrum) ** 2, 0.0)
        ratio = power / np.where(free, around, 1.0)
        peak = int(np.argmax(ratio))
        if ratio[peak] < limit or power[peak] < FAINT * strongest or len(found) == MOST:
            break
        strongest = max(strongest, float(power[peak]))
        offset, sd = _offset(np.abs(spectrum[peak - 1 : peak + 2]), float(around[peak]))
        first, last = max(0, peak - WIDE), min(spectrum.size, peak + WIDE + 1)
        shape = _shape(offset + peak - bins[first:last]) * (-1.0) ** (bins[first:last] - peak)
        spectrum[first:last] -= spectrum[peak] / shape[peak - first] * shape
        lobe = slice(peak - MAIN_LOBE, peak + MAIN_LOBE + 1)
        rest = float(np.sum(np.abs(spectrum[lobe]) ** 2)) - (2 * MAIN_LOBE + 1) * float(around[peak])
        free[lobe] = False
        if rest < REST * power[peak] + limit * around[peak]:
            found.append(_line(straight * window, (peak + offset) / n, sd / n, float(around[peak]), interval))
    return tuple(sorted(found, key=lambda line: -line.amplitude))


def _around(power: FloatArray) -> FloatArray:
    """Estimate the noise power around each bin by medians, robust against lines."""
    centres = np.geomspace(0.8 * FEWEST_CYCLES, power.size - 1.0, 2 + int(math.log(power.size, BAND_STEP)))
    level = []
    for centre in centres:
        first, last = max(1, int(min(centre / NEAR, centre - 20))), int(max(centre * NEAR, centre + 20))
        band = power[first : last + 1]
        level.append(np.median(band[:: 1 + band.size // MOST_OF_BAND]) / math.log(2.0))
    tiny = np.finfo(np.float64).tiny
    logs = np.interp(np.log(np.arange(1.0, power.size)), np.log(centres), np.log(np.maximum(level, tiny)))
    return np.concatenate([[0.0], np.exp(logs)])


def _shape(bins: FloatArray) -> FloatArray:
    """Compute the spectrum of the Hann window at these distances, 1 in the middle."""
    return np.asarray(np.sinc(bins) + 0.5 * (np.sinc(bins - 1.0) + np.sinc(bins + 1.0)))


def _offset(size: FloatArray, noise: float) -> tuple[float, float]:
    """Estimate the distance of a line from the highest bin by its larger neighbour, with sd [bins].

    `size` (3,): of the spectrum about it. `noise`: mean power of the noise. The ratio r of two bins of a Hann window is
    (1 + d) / (2 - d); noise of neighbours has the correlation 2/3.
    """
    right = size[2] > size[0]
    r = float(size[2] if right else size[0]) / float(size[1])
    d = (2.0 * r - 1.0) / (r + 1.0)
    sd = 3.0 / (r + 1.0) ** 2 * math.sqrt(0.5 * noise * (1.0 + r * r - 4.0 / 3.0 * r)) / float(size[1])
    return (d if right else -d), sd


def _line(windowed: FloatArray, cycles: float, cycles_sd: float, noise: float, interval: float) -> Sinusoid:
    """Fit a line of known frequency [cycles per sample] in a windowed signal."""
    n = windowed.size
    turned = windowed @ np.exp(-2j * np.pi * cycles * np.arange(n)) * 4.0 / n  # the window has the mean 1/2
    sd = 4.0 / n * math.sqrt(0.5 * noise)
    return Sinusoid(cycles / interval, cycles_sd / interval, float(abs(turned)), sd, float(np.angle(turned)))
