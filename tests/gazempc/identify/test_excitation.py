"""Excitation: within limits, one axis at a time, from where the neck stands."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.identify.excitation import ExcitationSettings, excite
from gazempc.neck.spec import NeckSpec, load_neck

PAN = load_neck("reference").pan
axes = st.fixed_dictionaries(
    {
        "position_min_deg": st.floats(-90, 20),
        "position_max_deg": st.floats(25, 180),
        "velocity_max_rad_s": st.floats(0.05, 8),
        "acceleration_max_rad_s2": st.floats(0.2, 80),
        "jerk_max_rad_s3": st.floats(5, 2000),
        "natural_frequency_rad_s": st.floats(4, 40),
        "damping_ratio": st.floats(0.3, 2),
    }
).map(lambda values: PAN.model_copy(update=values))


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
