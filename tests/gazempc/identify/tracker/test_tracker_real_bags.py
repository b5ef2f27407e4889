"""A real face tracker: its errors as they are known from outside."""

import numpy as np
import pytest

from gazempc.identify.tracker.measure import measure_tracker
from gazempc.identify.tracker.read import read_track


# Measured by other means on recordings of the same tracker: range 1 to 6 %, bearing 0.04 to 0.1 deg.
@pytest.mark.slow
def test_errors_of_a_face_tracker(bags_dir):
    found = measure_tracker(read_track(bags_dir / "1p_FV_eng_1", None, lambda share: None), lambda share: None)
    assert 0.01 < found.along.fit.white.value < 0.08
    assert 0.02 < np.rad2deg(found.across.fit.white.value) < 0.15
    assert found.frames.rate_hz == pytest.approx(30.0, rel=0.03)
    assert found.head_yaw is not None
