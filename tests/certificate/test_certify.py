"""The certificate: what insnav navigates with passes, plain integrators show their known errors, a defect is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav import strapdown
from insnav.certificate import strapdown_checks
from insnav.certificate.certify import Certificate, certify
from insnav.certificate.integrators import METHODS, Check, integrators
from insnav.certificate.platform_checks import gravity
from insnav.report.certificate.page import certificate_markdown
from insnav.units import DEG, DEG_PER_H, G0, UG
from tests.cli.conftest import ROOT

CERTIFICATE = ROOT / "reports" / "certificate.md"


@pytest.fixture(scope="session")
def certificate() -> Certificate:
    return certify()


def row(checks, topic: str, case: str) -> dict[str, float]:
    return next(dict(check.values) for check in checks if (check.topic, check.case) == (topic, case))


def test_the_default_integrator_passes_everything(certificate: Certificate):
    assert [f"{check.topic}: {check.case}" for check in certificate.failed] == []
    assert certificate.seconds > 0.0


def test_every_topic_is_asked_of_every_integrator(certificate: Certificate):
    topics = [check.topic for check in certificate.checks]
    asked = ("coning", "sculling", "spin", "pitch +-90 deg", "free inertial, height held", "Schuler period")
    strapdown_topics = {*asked, "rest for 4 h", "a day at rest with errors", "longitude", "poles"}
    assert {*strapdown_topics, "platform", "gravity"} == set(topics)
    assert (topics.count("coning"), topics.count("rest for 4 h"), topics.count("gravity")) == (13, 4, 11)
    for check in certificate.checks:
        assert np.isfinite([value for _, value in check.values]).all(), check
        assert all(value >= 0.0 for _, value in check.values), check
        if check.topic in strapdown_topics:
            assert tuple(name for name, _ in check.values) == METHODS
    assert METHODS[0] == "polynomial"


def test_the_bars_are_those_promised(certificate: Certificate):
    bars = {(check.topic, check.case): (check.limit, check.unit) for check in certificate.checks}
    for case, bar in (("1 deg, 1 Hz", 1e-4), ("1 deg, 5 Hz", 0.02), ("1 deg, 10 Hz", 0.1)):
        assert bars["coning", case] == (bar, "deg/h")
    assert bars["sculling", "0.1 deg, 1 g, 10 Hz"] == (0.5, "ug")
    assert bars["free inertial, height held", "1 h of circles at 20 m/s"] == (0.03, "m")
    assert bars["poles", "10 min at 250 m/s over the North Pole"] == (0.01, "m")
    assert bars["gravity", "at the ellipsoid, down"] == (1e-8, "m/s^2")
    assert bars["gravity", "20 km, north"] == (1.0, "ug")


@pytest.mark.parametrize("frequency", [1.0, 5.0, 10.0, 20.0])
@pytest.mark.parametrize("angle_deg", [0.1, 1.0, 3.0])
def test_without_correction_coning_drifts_as_the_formula_says(certificate: Certificate, angle_deg, frequency):
    # the mean rate of a cone that sums of the rate do not see, w (theta^2 / 2) (1 - sin(wT) / (wT)):
    # Savage (1998), part 1, section on the error of the coning term
    w, theta = 2 * np.pi * frequency, angle_deg * DEG
    missed = 0.5 * w * theta**2 * (1 - np.sin(0.01 * w) / (0.01 * w)) / DEG_PER_H
    found = row(certificate.checks, "coning", f"{angle_deg:g} deg, {frequency:g} Hz")
    for method in ("rotvec", "rk4", "euler"):
        assert found[method] == pytest.approx(missed, rel=3e-3)


def test_without_correction_sculling_errs_as_the_formula_says(certificate: Certificate):
    phase = 2 * np.pi * 10.0 * 0.01
    missed = 0.5 * 0.1 * DEG * G0 * (1 - np.sin(phase) / phase) / UG  # the same for rotation and force in phase
    assert row(certificate.checks, "sculling", "0.1 deg, 1 g, 10 Hz")["rotvec"] == pytest.approx(missed, rel=3e-3)


def test_euler_drifts_in_a_spin_by_its_arctangent(certificate: Certificate):
    angle = 1000 * DEG * 0.01
    missed = (angle - 2 * np.arctan(0.5 * angle)) / 0.01 / DEG_PER_H
    found = row(certificate.checks, "spin", "1000 deg/s, attitude")
    assert missed * DEG_PER_H * 40.0 < np.pi  # else it would be lost whole turns
    assert found["euler"] == pytest.approx(missed, rel=1e-6)
    assert found["rotvec"] < 1e-6


def without(name: str):
    """The increments of the default integrator with one of their terms left out."""
    whole = strapdown.increments

    def increments(parts, pieces=None, *, method="polynomial"):
        found = whole(parts, pieces, method=method)
        return replace(found, **{name: np.zeros_like(found.coning)}) if method == "polynomial" else found

    return increments


@pytest.mark.parametrize(
    ("term", "topic", "case"),
    [
        ("coning", strapdown_checks.coning, "1 deg, 10 Hz"),
        ("sculling", strapdown_checks.sculling, "0.1 deg, 1 g, 10 Hz"),
    ],
)
def test_a_missing_term_is_named(monkeypatch, term, topic, case):
    monkeypatch.setattr(strapdown, "increments", without(term))
    failed = [check for check in topic(integrators()) if not check.passed]
    assert case in [check.case for check in failed]
    assert all(check.topic == term for check in failed)


def turned_by(angle: float):
    """Navigation whose attitude at the start is off."""
    whole = strapdown.navigate

    def navigate(inc, lla, v_n, rph, **options):
        return whole(inc, lla, v_n, rph + np.array([angle, 0.0, 0.0]), **options)

    return navigate


@pytest.mark.parametrize(
    "topic",
    [strapdown_checks.upright, strapdown_checks.free_inertial, strapdown_checks.rest, strapdown_checks.poles],
    ids=lambda t: t.__name__,
)
def test_a_tilt_of_a_tenth_of_a_microradian_is_found(monkeypatch, topic):
    monkeypatch.setattr(strapdown, "navigate", turned_by(1e-7))
    failed = {check.case for check in topic(integrators()[:1]) if not check.passed}
    assert len(failed) >= 3


def test_a_longitude_that_is_not_wrapped_is_found(monkeypatch):
    whole = strapdown.navigate

    def navigate(*arguments, **options):
        found = whole(*arguments, **options)
        found.lla[:, 1] = np.unwrap(found.lla[:, 1])
        return found

    monkeypatch.setattr(strapdown, "navigate", navigate)
    failed = [check.case for check in strapdown_checks.meridians(integrators()[:1]) if not check.passed]
    assert failed == ["crossing date line"]


def test_a_wrong_period_is_found(monkeypatch):
    whole = strapdown_checks.radii
    monkeypatch.setattr(strapdown_checks, "radii", lambda lat: whole(lat)[::-1])  # that of the other channel
    assert not strapdown_checks.schuler(integrators()[:1])[0].passed


@pytest.mark.parametrize("value", [np.nan, np.inf, 1.1])
def test_what_is_no_number_does_not_pass(value):
    assert not Check("topic", "case", "m", 1.0, (("insnav", value),)).passed
    assert Check("topic", "case", "m", 1.0, (("insnav", 1.0), ("other", value))).passed
    assert not Check("topic", "case", "m", 1.0, (("insnav", 1.0), ("other", value)), required=2).passed
    assert not Check("topic", "case", "m", 1.0, (("other", value), ("insnav", 1.0)), required=2).passed


def test_a_latitude_that_is_no_number_is_not_beyond_nothing(monkeypatch):
    whole = strapdown.navigate

    def navigate(*arguments, **options):
        found = whole(*arguments, **options)
        found.lla[5] = np.nan
        return found

    monkeypatch.setattr(strapdown, "navigate", navigate)
    failed = [check.case for check in strapdown_checks.poles(integrators()[:1]) if not check.passed]
    assert "the same: latitude beyond 90 deg" in failed


def test_progress_is_told(monkeypatch):
    from insnav.certificate import certify as module

    monkeypatch.setattr(module, "TOPICS", (strapdown_checks.sculling, strapdown_checks.spin))
    monkeypatch.setattr(module, "OTHERS", (gravity,))
    told: list[float] = []
    found = certify(progress=told.append)
    assert told == sorted(told)
    assert 0.0 < told[0] <= told[-1] <= 1.0
    assert {check.topic for check in found.checks} == {"sculling", "spin", "gravity"}


def test_another_package_stands_beside():
    pytest.importorskip("pyins", reason="python-ins is not installed")
    from insnav.certificate.integrators import pyins

    found = [
        *strapdown_checks.coning((*integrators()[:1], pyins())),
        *strapdown_checks.meridians((*integrators()[:1], pyins())),
    ]
    # figures measured beforehand by a program of their own
    for case, drift in (("1 deg, 1 Hz", 1e-4), ("1 deg, 5 Hz", 0.32), ("1 deg, 10 Hz", 9.8)):
        assert row(found, "coning", case)["pyins"] == pytest.approx(drift, rel=0.05)
    assert row(found, "longitude", "crossing Greenwich")["pyins"] < 1e-6


def test_the_committed_certificate_has_every_check_and_limit(certificate: Certificate):
    text = [*CERTIFICATE.read_text(encoding="utf-8").splitlines(), ""]
    lines = certificate_markdown(certificate).splitlines()
    begin = text.index(lines[0])
    shown = text[begin : text.index("", begin)]
    assert [row.split("|")[1:3] for row in shown] == [row.split("|")[1:3] for row in lines]
    # figures of rounding depend on the machine; whether they keep the limit does not
    assert [row.split("|")[3].endswith("! ") for row in shown] == [row.split("|")[3].endswith("! ") for row in lines]
