"""Excitation: within limits, one axis at a time, from where the neck stands."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.identify.excitation import ExcitationSettings, excite
from gazempc.neck.spec import Axis, NeckSpec

axes = st.builds(
    lambda low, span, v, a, j, wn, zeta: Axis(
        position_min_deg=low,
        position_max_deg=low + span,
        velocity_max_rad_s=v,
        acceleration_max_rad_s2=a,
        jerk_max_rad_s3=j,
        natural_frequency_rad_s=wn,
        damping_ratio=zeta,
        dead_time_s=0.1,
    ),
    low=st.floats(-90, 20),
    span=st.floats(5, 160),
    v=st.floats(0.05, 8),
    a=st.floats(0.2, 80),
    j=st.floats(5, 2000),
    wn=st.floats(4, 40),
    zeta=st.floats(0.3, 2),
)


@settings(max_examples=12)
@given(
    pan=axes,
    tilt=axes,
    rates=st.sampled_from([(50.0, 50.0), (50.0, 200.0), (100.0, 500.0)]),
    how=st.builds(
        ExcitationSettings,
        axes=st.sampled_from([("all",), ("in_turn",), ("pan",)]),
        duration_s=st.just(8.0),
        amplitude_deg=st.floats(1, 90),
        seed=st.integers(0, 9),
    ),
)
def test_excitation_stays_within_limits(pan, tilt, rates, how):
    neck = NeckSpec(name="any", source="test", pan=pan, tilt=tilt, control_rate_hz=rates[0], servo_rate_hz=rates[1])
    limits, h = neck.command_limits, neck.servo_period_s
    start = neck.rest_rad
    motion = excite(neck, start, how)
    # At rest before and after: the differences there count as well.
    u = np.concatenate([np.tile(start, (3, 1)), motion.position_rad, np.tile(motion.position_rad[-1], (3, 1))])
    assert np.all(u >= limits.position_min_rad - 1e-9)
    assert np.all(u <= limits.position_max_rad + 1e-9)
    for order, bound in enumerate(
        (limits.velocity_max_rad_s, limits.acceleration_max_rad_s2, limits.jerk_max_rad_s3), start=1
    ):
        peak = np.abs(np.diff(u, order, axis=0)).max(axis=0) / h**order
        assert np.all(peak <= bound * (1 + 1e-6) + 1e-13 / h**order), order
    assert np.ptp(motion.position_rad[:, 0]) > 0
    assert (np.ptp(motion.position_rad[:, 1]) > 0) == (how.axes != ("pan",))
