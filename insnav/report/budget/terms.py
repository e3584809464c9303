"""Sources of an error budget in words: how large in field units, how they grow, what they do."""

from __future__ import annotations

from insnav.errors.budget.error_budget import Budget
from insnav.units import DEG, UNITS

_ROOT_HOUR = 60.0  # square root of an hour [sqrt(s)]
# by family: unit in which its size is told
_UNITS = {
    "initial position": "m",
    "initial velocity": "m/s",
    "initial tilt": "deg",
    "initial heading": "deg",
    "gyro bias": "deg/h",
    "gyro bias instability": "deg/h",
    "gyro white noise": "deg/sqrt(h)",
    "gyro flicker noise": "deg/h",
    "gyro bias ramp": "deg/h/h",
    "gyro non-linearity": "ppm/(deg/s)",
    "gyro g-sensitivity": "deg/h/g",
    "accel bias": "ug",
    "accel bias instability": "ug",
    "accel white noise": "m/s/sqrt(h)",
    "accel flicker noise": "ug",
    "accel bias ramp": "ug/h",
    "accel non-linearity": "ug/g^2",
    "gravity model": "mGal",
    "timing offset": "ms",
    "timing drift": "ppm",
}
_BY_TERM = {"scale factor": "ppm", "misalignment": "mrad", "asymmetry": "ppm"}
_WALKS = {"gyro": ("deg/h/sqrt(h)", DEG / 3600.0 / _ROOT_HOUR), "accel": ("ug/sqrt(h)", UNITS["ug"][1] / _ROOT_HOUR)}
# by family: how often it is integrated to position
_INTEGRALS = {"initial position": 0, "initial velocity": 1, "initial tilt": 2, "initial heading": 2}
_POWERS = {0.0: "stays", 1.0: "t", 1.5: "t¹·⁵", 2.0: "t²", 2.5: "t²·⁵", 3.0: "t³", 3.5: "t³·⁵", 4.0: "t⁴"}

EFFECTS = {
    "initial position": "stays what it is",
    "initial velocity": "goes on: v t",
    "initial tilt": "gravity shows in the level axes and is taken for motion: g φ t² / 2",
    "initial heading": "turns every change of velocity: ψ Δv across, and nothing at constant velocity",
    "gyro bias": "tilts the level at a steady rate, and gravity follows: g ε t³ / 6",
    "gyro bias instability": "as a bias that wanders with its correlation time (Gauss-Markov)",
    "gyro white noise": "angle random walk N: the tilt walks at random, g N √(t⁵ / 20)",
    "gyro scale factor": "a part of every turn is missed; at rest only of the Earth's",
    "gyro misalignment": "turns about one axis show as turns about another",
    "gyro rate random walk": "the bias walks at random, K: g K √(t⁷ / 252)",
    "gyro flicker noise": "bias that changes on every time scale alike",
    "gyro bias ramp": "the bias grows steadily, R: g R t⁴ / 24",
    "gyro asymmetry": "scale factors of left and right turns differ",
    "gyro non-linearity": "a part of the square of the rate shows as a bias",
    "gyro g-sensitivity": "specific force shows as a rate; at rest a bias of one g",
    "accel bias": "is taken for motion: B t² / 2",
    "accel bias instability": "as a bias that wanders with its correlation time (Gauss-Markov)",
    "accel white noise": "velocity random walk N: N √(t³ / 3)",
    "accel scale factor": "a part of gravity is missed in the vertical, and a part of accelerations in the level",
    "accel misalignment": "gravity shows in the level axes as a bias of m g",
    "accel rate random walk": "the bias walks at random, K: K √(t⁵ / 20)",
    "accel flicker noise": "bias that changes on every time scale alike",
    "accel bias ramp": "the bias grows steadily, R: R t³ / 6",
    "accel asymmetry": "scale factors of both signs differ; at rest as a scale factor",
    "accel non-linearity": "a part of the square of the specific force shows as a bias",
    "gravity model": "gravity that the model does not have is taken for motion: Δg t² / 2",
    "timing offset": "late samples: τ times the change of velocity",
    "timing drift": "samples that come later and later",
}


def size(budget: Budget, family: str) -> str:
    """Size of a family in a field unit, from the least to the largest axis if they differ.

    Parameters
    ----------
    budget : Budget
    family : str
    """
    values = sorted({source.sd for source in budget.sources if source.family == family and source.sd > 0.0})
    group, _, term = family.partition(" ")
    if term == "rate random walk":
        unit, factor = _WALKS[group]
    else:
        unit = _UNITS.get(family) or _BY_TERM[term]
        factor = UNITS[unit][1]
    shown = [f"{float(f'{value / factor:.3g}'):g}" for value in values]
    text = shown[0] if shown[0] == shown[-1] else f"{shown[0]} to {shown[-1]}"
    return f"{text} {unit}"


def growth(budget: Budget, family: str) -> str:
    """Power of the time with which a family makes position errors, at rest and within minutes.

    Parameters
    ----------
    budget : Budget
    family : str
    """
    source = next(each for each in budget.sources if each.family == family)
    if source.group == "timing":
        return "motion"
    order = _INTEGRALS.get(family, 3 if source.group == "gyro" else 2)
    more = {"ramp": 1.0, "white": -0.5, "random walk": 0.5}.get(source.kind, 0.0)
    return _POWERS[order + more]
