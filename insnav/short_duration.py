"""The short-duration mechanization: what is left of the navigation equations for a minute or so."""

from __future__ import annotations

import numpy as np

from insnav.attitude import quat_from_rph, rph_from_quat
from insnav.kernels import short_duration as _kernel
from insnav.types import FloatArray, Increments, Trajectory


def navigate_short(
    inc: Increments, lla: FloatArray, v_n: FloatArray, rph: FloatArray, *, turning: bool = True, every: int = 1
) -> Trajectory:
    """Free-inertial navigation by ``v(t + T) = v(t) + T (f_n + g)``: Earth and transport rate dropped, Euler's rule.

    `inc`: its sculling is not used; `lla`, `v_n`, `rph` (3,): latitude, longitude [rad], height [m]; velocity North,
    East, Down [m/s]; roll, pitch, heading [rad] at the start of the first interval; `turning`: whether the attitude
    still follows the turn of North, East, Down. Without it the attitude stays in the axes of the start, which tilt
    against the level at the Earth's rate: by far the larger error; `every`: return every so-manieth state.
    Returns: states at the ends of intervals ``every``, ``2 every``, …

    Notes
    -----
    Velocity: Groves (2013), eq. 5.53 without its Coriolis term. The specific force is turned by the attitude at the
    start of each interval, the position moved with the velocity there. Against the full form the velocity is wrong by
    the integral of ``(2 w_ie + w_en) x v``: horizontally about ``2 W sin(L) v t``, the position by half that times t.
    """
    x = np.concatenate([lla, v_n, quat_from_rph(rph)])
    out = np.empty((inc.time.shape[0] // every, 10))
    _kernel.navigate(x, turning, inc.dt, inc.dtheta, inc.dvel, inc.coning, every, out)
    time = inc.time[every - 1 :: every][: out.shape[0]]
    return Trajectory(time, out[:, :3], out[:, 3:6], rph_from_quat(out[:, 6:]))
