"""Excitation: within limits, one axis at a time, from where the neck stands."""

import numpy as np
from builders.control import assert_within
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
        axes=st.sampled_from([("all",), ("pan",)]),
        duration_s=st.just(8.0),
        amplitude_deg=st.floats(1, 90),
        seed=st.integers(0, 9),
    ),
)
def test_excitation_stays_within_limits(pan, tilt, rates, how):
    neck = NeckSpec(name="any", source="test", pan=pan, tilt=tilt, control_rate_hz=rates[0], servo_rate_hz=rates[1])
    start = neck.rest_rad
    motion = excite(neck, start, how)
    # At rest before and after: the differences there count as well.
    u = np.concatenate([start[None], motion.position_rad, np.tile(motion.position_rad[-1], (3, 1))])
    assert_within(neck.command_limits, u, neck.servo_period_s)
    assert np.ptp(motion.position_rad[:, 0]) > 0
    assert (np.ptp(motion.position_rad[:, 1]) > 0) == (how.axes != ("pan",))
