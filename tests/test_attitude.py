"""Attitude conversions against scipy's rotations, and there and back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from insnav import attitude as at

RNG = np.random.default_rng(20)
RPH = np.column_stack([RNG.uniform(-np.pi, np.pi, 200), RNG.uniform(-1.57, 1.57, 200), RNG.uniform(0, 2 * np.pi, 200)])
ORACLE = Rotation.from_euler("ZYX", RPH[:, ::-1])
QUAT = ORACLE.as_quat(canonical=True, scalar_first=True)


def same_rotation(p, q, tolerance=1e-14):
    p, q = np.asarray(p), np.asarray(q)
    assert np.minimum(np.abs(p - q).max(-1), np.abs(p + q).max(-1)).max() < tolerance


def test_quaternion_of_roll_pitch_heading_is_scipys():
    same_rotation(at.quat_from_rph(RPH), QUAT)


def test_matrix_is_scipys():
    np.testing.assert_allclose(at.dcm_from_quat(QUAT), ORACLE.as_matrix(), atol=1e-15)
    np.testing.assert_allclose(at.dcm_from_rph(RPH), ORACLE.as_matrix(), atol=1e-15)


def test_body_axes_point_where_the_convention_says():
    down = at.dcm_from_rph([0.0, 0.0, np.pi / 2]) @ [1.0, 0.0, 0.0]
    np.testing.assert_allclose(down, [0.0, 1.0, 0.0], atol=1e-15)  # heading 90 deg: forward is east
    np.testing.assert_allclose(at.dcm_from_rph([0.0, 0.1, 0.0]) @ [1, 0, 0], [np.cos(0.1), 0, -np.sin(0.1)])  # nose up
    np.testing.assert_allclose(
        at.dcm_from_rph([0.1, 0.0, 0.0]) @ [0, 1, 0], [0, np.cos(0.1), np.sin(0.1)]
    )  # right down


def test_small_turns_change_roll_pitch_and_heading_as_scipys_do():
    """Banked and pitched, too, where a turn about Down is no change of heading alone."""
    turn = 1e-6 * RNG.standard_normal((200, 3))
    after = (Rotation.from_rotvec(turn) * ORACLE).as_euler("ZYX")[:, ::-1]
    change = (after - ORACLE.as_euler("ZYX")[:, ::-1] + np.pi) % (2 * np.pi) - np.pi
    flat = np.abs(RPH[:, 1]) < 1.4
    np.testing.assert_allclose(at.rph_by_turn(ORACLE.as_matrix(), turn)[flat], change[flat], atol=1e-9)


def test_product_is_the_second_rotation_first():
    other = Rotation.random(200, random_state=1)
    product = at.quat_multiply(QUAT, other.as_quat(scalar_first=True))
    same_rotation(product, (ORACLE * other).as_quat(scalar_first=True))


def test_conjugate_is_the_inverse():
    same_rotation(at.quat_conjugate(QUAT), ORACLE.inv().as_quat(scalar_first=True))


def test_rotation_vectors_are_scipys():
    vector = ORACLE.as_rotvec()
    same_rotation(at.quat_from_rotvec(vector), QUAT)
    np.testing.assert_allclose(at.rotvec_from_quat(-QUAT), vector, atol=1e-13)


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-12, 1e-5, 1.0, np.pi - 1e-9, np.pi])
def test_rotation_vector_survives_any_size(size):
    vector = size * np.array([2.0, -3.0, 6.0]) / 7.0
    np.testing.assert_allclose(at.rotvec_from_quat(at.quat_from_rotvec(vector)), vector, rtol=1e-13, atol=1e-320)


def test_quaternion_of_any_matrix():
    np.testing.assert_allclose(at.quat_from_dcm(ORACLE.as_matrix()), QUAT, atol=1e-14)


@pytest.mark.parametrize("axis", np.vstack([np.eye(3), [[0.6, 0.8, 0.0]], [[0.0, -0.6, 0.8]]]))
def test_quaternion_of_half_turns_loses_no_digits(axis):
    for angle in (np.pi, np.pi - 1e-10):
        turn = Rotation.from_rotvec(angle * axis)
        same_rotation(at.quat_from_dcm(turn.as_matrix()), turn.as_quat(scalar_first=True), 1e-15)


@given(st.floats(-np.pi, np.pi), st.floats(-np.pi / 2 + 1e-6, np.pi / 2 - 1e-6), st.floats(0.0, 6.283))
def test_roll_pitch_heading_come_back(roll, pitch, heading):
    back = at.rph_from_quat(at.quat_from_rph([roll, pitch, heading]))
    difference = at.wrap_pi(back - [roll, pitch, heading])
    difference[0] = min(abs(difference[0]), 2 * np.pi - abs(difference[0]))
    # roll and heading blur as pitch nears the vertical
    assert np.abs(difference).max() < 1e-14 / np.cos(pitch) + 1e-14
    assert abs(back[1] - pitch) < 1e-14


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-9, 1e-7])
def test_vertical_pitch_keeps_the_attitude(sign, off):
    for heading in (0.0, 1.0, 4.0):
        q = at.quat_from_rph([0.3, sign * (np.pi / 2 - off), heading])
        rph = at.rph_from_quat(q)
        assert np.isfinite(rph).all()
        assert abs(rph[1] - sign * (np.pi / 2 - off)) < 1e-15
        # heading minus (plus) roll is defined, whatever is made of each
        apart = at.wrap_pi((heading - sign * 0.3) - (rph[2] - sign * rph[0]))
        assert abs(apart) < 1e-8


def test_heading_of_a_quaternion_is_in_its_range():
    rph = at.rph_from_quat(at.quat_from_rph([[0.0, 0.0, -1e-20], [0.0, 0.0, 2 * np.pi], [0.0, 0.0, -0.1]]))
    assert ((rph[:, 2] >= 0.0) & (rph[:, 2] < 2 * np.pi)).all()
    assert rph[2, 2] == pytest.approx(2 * np.pi - 0.1)


@given(st.floats(-1e4, 1e4))
def test_wrapped_angles_are_in_their_range_and_the_same_angle(angle):
    for wrap, low in ((at.wrap_pi, -np.pi), (at.wrap_two_pi, 0.0)):
        wrapped = float(wrap(angle))
        assert low <= wrapped < low + 2 * np.pi
        assert np.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-10)


def test_skew_is_the_cross_product():
    u, v = RNG.standard_normal((2, 5, 3))
    np.testing.assert_allclose((at.skew(u) @ v[..., None])[..., 0], np.cross(u, v))
