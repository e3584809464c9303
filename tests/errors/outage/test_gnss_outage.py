"""Windows without fixes: the same as a filter that never had them, and as uncertain as predicted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.earth import lla_offset, ned_offset
from insnav.errors.metrics import at_point
from insnav.errors.outage import gnss_outage
from insnav.errors.outage.gnss_outage import RECOVERY, outage_growth, outages
from insnav.exceptions import ConfigError, InputError
from insnav.filter.filter_input import FilterInput
from insnav.filter.gps_noise import CorrelatedNoise
from insnav.filter.navigate import feed
from insnav.filter.navigator import Navigator
from insnav.simulate import reference, without_fixes
from tests.filter import drives

QUIET = 1e-3  # [m], [m/s]


def prepared(seed: int) -> FilterInput:
    rng = np.random.default_rng([41, seed])
    imu = drives.noisy_imu(drives.perfect_imu(), drives.MODEL, rng)
    gps = drives.noisy_gps(drives.perfect_gps(), rng)
    start = drives.begin(drives.MODEL, rng)
    return drives.ready(imu, gps, start, output_interval=1.0, gates=drives.UNFAILING)


def exact() -> object:
    """Fixes without errors, as a reference."""
    gps = drives.perfect_gps()
    small = np.full_like(gps.position_sd, QUIET)
    return replace(gps, position_sd=small, velocity_sd=small)


def test_a_window_is_what_a_filter_without_those_fixes_does():
    ready = prepared(0)
    (window,) = outages(ready, lengths=[30.0], first=100.0, spacing=1000.0)
    gps = without_fixes(ready.gps, window.start, window.start + 30.0)
    gps = without_fixes(gps, window.start + 30.0 + RECOVERY, np.inf)  # the smoother of a window gets no later ones
    navigator = Navigator(replace(ready, gps=gps))
    feed(navigator, ready.imu)
    run = navigator.finish()
    for solution, error in ((run.solution, window.error), (run.smoothed.solution, window.smoothed)):
        row = int(np.searchsorted(solution.time, window.start + 20.0 - 1e-3))
        at = int(np.searchsorted(ready.gps.time, window.start + 20.0 - 1e-3))
        true = reference(drives.truth(), solution.time[row : row + 1])
        # antenna minus fix = IMU minus truth, minus the error of the fix, but for the arm turned by the attitude error
        fix_error = ned_offset(ready.gps.lla[at], drives.perfect_gps().lla[at])
        expected = ned_offset(solution.lla[row], true.lla[0]) - fix_error
        np.testing.assert_allclose(error[19, :3], expected, atol=0.02)


def test_against_a_reference_all_that_the_solution_errs_counts_and_is_predicted():
    """Not only what it errs against fixes that share most of its error, and lag in velocity."""
    ready = prepared(3)
    lasting = CorrelatedNoise(0.9, 300.0, np.sqrt(0.9) * np.median(ready.gps.position_sd, axis=0))
    ready = drives.changed(ready, correlated=lasting, velocity_lag=0.2)
    (window,) = outages(ready, lengths=[4.0], first=100.0, spacing=1000.0, reference=exact())
    navigator = Navigator(replace(ready, gps=without_fixes(ready.gps, window.start, np.inf)))
    feed(navigator, ready.imu)
    alone = navigator.finish().solution
    row = int(np.searchsorted(alone.time, window.start + 3.0 - 1e-3))
    part = alone.rows(slice(row, row + 1))
    np.testing.assert_allclose(window.sd[2, :3], part.sd[0, :3], rtol=0.05)  # that of the lever arm is in it
    true = reference(drives.truth(), part.time)
    np.testing.assert_allclose(window.error[2, 3:], part.v_n[0] - true.v_n[0], atol=0.02)
    found, true = (at_point(each, drives.LEVER_B) for each in (part, true))
    np.testing.assert_allclose(window.error[2, :3], ned_offset(found.lla[0], true.lla[0]), atol=0.01)
    assert np.all(window.sd[2, :3] > 0.5 * lasting.sd)


def test_errors_are_as_large_as_predicted():
    windows = [
        w for seed in range(10) for w in outages(prepared(seed), lengths=[20.0], spacing=40.0, reference=exact())
    ]
    (found,) = outage_growth(windows)
    rms, smoothed = (found.corrected[-1, found.column(name)] for name in ("horizontal", "smoothed horizontal"))
    predicted, smoothed_sd = (found.predicted[-1, found.column(name)] for name in ("horizontal", "smoothed horizontal"))
    print(
        f"{found.count} windows: RMS {rms:.2f} m, predicted {predicted:.2f} m; smoothed {smoothed:.2f}, its sd "
        f"{smoothed_sd:.2f} m; inside 3 sd {100 * found.inside_at_end:.1f} %"
    )
    assert found.count > 40
    assert 0.75 < rms / predicted < 1.3
    assert found.inside_at_end > 0.97
    assert smoothed < 0.5 * rms


def test_reference_variance_is_subtracted():
    noisy = [w for seed in range(6) for w in outages(prepared(seed), lengths=[2.0], spacing=10.0)]
    clean = [w for seed in range(6) for w in outages(prepared(seed), lengths=[2.0], spacing=10.0, reference=exact())]
    by_fixes, by_truth = (outage_growth(each)[0] for each in (noisy, clean))
    print("RMS by fixes, corrected:", by_fixes.corrected[-1, 0], "by truth:", by_truth.corrected[-1, 0])
    assert by_fixes.corrected[-1, 0] == pytest.approx(by_truth.corrected[-1, 0], rel=0.25)
    assert by_fixes.p95[-1, 0] > 1.5 * by_truth.p95[-1, 0]  # quantiles are left as they are


def test_errors_grow_with_the_length():
    sums = outage_growth(outages(prepared(1), lengths=[5.0, 15.0, 45.0], reference=exact()))
    rms = [each.corrected[-1, 0] for each in sums]
    assert rms == sorted(rms)
    assert rms[-1] > 3.0 * rms[0]
    assert [each.length for each in sums] == [5.0, 15.0, 45.0]


def test_two_processes_find_the_same():
    ready = prepared(2)
    one, two = (outages(ready, lengths=[5.0], spacing=60.0, workers=n) for n in (1, 2))
    assert len(one) == len(two) > 1
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.error, b.error)
        np.testing.assert_array_equal(a.smoothed, b.smoothed)


def test_a_fix_marked_as_none_is_no_reference():
    ready = prepared(3)
    fix = np.ones(ready.gps.time.shape[0], dtype=np.int64)
    wild = lla_offset(ready.gps.lla, np.full((fix.shape[0], 3), 1e4))
    fix[170::3] = 0
    lla = np.where((fix == 0)[:, None], wild, ready.gps.lla)
    windows = outages(replace(ready, gps=replace(ready.gps, lla=lla, fix=fix)), lengths=[10.0], spacing=30.0)
    assert max(np.abs(w.error[:, :3]).max() for w in windows) < 100.0


@pytest.mark.parametrize(("lengths", "spacing"), [([], None), ([0.0], None), ([5.0], -1.0), ([np.inf], None)])
def test_lengths_and_spacing_must_be_above_zero(lengths, spacing):
    with pytest.raises(ConfigError, match=r"outage.bad_windows"):
        outages(prepared(0), lengths=lengths, spacing=spacing)


def test_a_window_longer_than_the_drive_is_refused():
    with pytest.raises(InputError, match=r"outage.drive_too_short"):
        outages(prepared(0), lengths=[1000.0])


def test_receiver_headings_are_lost_in_the_outage_and_back_after_it():
    ready = prepared(1)
    gps = replace(ready.gps, heading=np.linspace(0.0, 1.0, len(ready.gps.time)))
    start = float(gps.time[40])
    fixes = gnss_outage._fixes(gps, None, start, start + 20.0, start + 30.0)
    inside = fixes.time <= start + 20.0
    assert np.isnan(fixes.heading[inside]).all()
    assert not fixes.fix[inside].any()
    after = (gps.time > start + 20.0) & (gps.time <= start + 30.0)
    np.testing.assert_array_equal(fixes.heading[~inside], gps.heading[after])
    assert fixes.fix[~inside].all()
