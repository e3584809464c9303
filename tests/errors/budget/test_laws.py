"""The closed laws, derived once more by computer algebra."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from insnav.errors.budget import predicted as laws
from insnav.units import DEG, DEG_PER_H

T, U, V, W = sp.symbols("t u v w", positive=True)
TIMES = np.array([0.5, 10.0, 60.0, 300.0, 4000.0])
G = 9.7803


def value(expression: sp.Expr, t: float, w: float = 1.0) -> float:
    return float(sp.N(expression.subs({T: sp.Float(t, 60), W: sp.Float(w, 60)}), 30, maxn=200))


def kernel(order: int, age: sp.Expr) -> sp.Expr:
    """What is left of a pulse in the n-fold integral after some time."""
    return age ** (order - 1) / sp.factorial(order - 1)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_constant_ramp_white_noise_and_random_walk(order):
    wanted = {
        "constant": sp.integrate(kernel(order, T - U), (U, 0, T)),
        "ramp": sp.integrate(kernel(order, T - U) * U, (U, 0, T)),
        "white": sp.sqrt(sp.integrate(kernel(order, T - U) ** 2, (U, 0, T))),
        # a random walk is white noise integrated once more: a pulse is a step from then on
        "random walk": sp.sqrt(sp.integrate(sp.integrate(kernel(order, T - V), (V, U, T)) ** 2, (U, 0, T))),
    }
    for kind, expression in wanted.items():
        np.testing.assert_allclose(laws.integral(kind, order, TIMES), [value(expression, t) for t in TIMES], rtol=1e-13)


# answers of the loop p'' + w^2 p = what drives it; a gyro bias drives it with g eps t
LOOP = {
    "constant": {1: sp.sin(W * T) / W, 2: (1 - sp.cos(W * T)) / W**2, 3: (W * T - sp.sin(W * T)) / W**3},
    "ramp": {2: (W * T - sp.sin(W * T)) / W**3, 3: (W**2 * T**2 / 2 - 1 + sp.cos(W * T)) / W**4},
}


def test_the_answers_solve_the_equation_of_the_loop():
    drive = {("constant", 1): 0, ("constant", 2): 1, ("constant", 3): T, ("ramp", 2): T, ("ramp", 3): T**2 / 2}
    for (kind, order), given in drive.items():
        p = LOOP[kind][order]
        assert sp.simplify(sp.diff(p, T, 2) + W**2 * p - given) == 0
        assert p.subs(T, 0) == 0
        assert sp.diff(p, T).subs(T, 0) == (1 if (kind, order) == ("constant", 1) else 0)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_closed_schuler_forms(order):
    rate = 1.24e-3
    pulse = {1: sp.cos(W * U), 2: sp.sin(W * U) / W, 3: (1 - sp.cos(W * U)) / W**2}[order]
    step = {1: sp.sin(W * U) / W, 2: (1 - sp.cos(W * U)) / W**2, 3: (W * U - sp.sin(W * U)) / W**3}[order]
    forms = {
        "white": sp.sqrt(sp.integrate(sp.expand(pulse**2), (U, 0, T))),
        "random walk": sp.sqrt(sp.integrate(sp.expand(step**2), (U, 0, T))),
        "constant": LOOP["constant"][order],
    }
    if order > 1:
        forms["ramp"] = LOOP["ramp"][order]
    late = TIMES[TIMES > laws.SHORT]
    for kind, form in forms.items():
        found = laws.schuler(kind, order, late, rate) * laws.integral(kind, order, late)
        np.testing.assert_allclose(found, [value(form, t, w=rate) for t in late], rtol=1e-6)


def test_short_forms_are_what_the_schuler_forms_begin_with():
    for kind in ("constant", "ramp", "white", "random walk"):
        for order in (1, 2, 3):
            assert laws.schuler(kind, order, 60.0, 1.24e-3) == pytest.approx(1.0, abs=2e-3)


def test_one_minute_by_hand():
    bias, drift, tilt, t = 50e-6 * G, 0.00806 * DEG_PER_H, 0.003 * DEG, 60.0
    square, cube = laws.integral("constant", 2, t), laws.integral("constant", 3, t)
    terms = [bias * square, G * tilt * square, G * drift * cube]
    assert [round(float(term), 4) for term in terms] == [0.8802, 0.9218, 0.0138]
    assert round(float(sum(terms)), 3) == 1.816


def test_textbook_laws():
    t = 60.0
    assert 0.1 * laws.integral("constant", 1, t) == pytest.approx(6.0)
    # accelerometers: velocity random walk, rate random walk
    assert 0.002 * laws.integral("white", 2, t) == pytest.approx(0.002 * t**1.5 / np.sqrt(3))
    assert 1e-4 * laws.integral("random walk", 2, t) == pytest.approx(1e-4 * np.sqrt(t**5 / 20))
    # gyros: angle random walk, rate random walk
    assert G * 2e-5 * laws.integral("white", 3, t) == pytest.approx(G * 2e-5 * np.sqrt(t**5 / 20))
    assert G * 1e-7 * laws.integral("random walk", 3, t) == pytest.approx(G * 1e-7 * np.sqrt(t**7 / 252))
