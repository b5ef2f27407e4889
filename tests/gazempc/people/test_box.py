"""Several people as one target."""

import numpy as np
import pytest

from gazempc.people.box import middle_of
from predictors import Forecast


def at(pan_deg, tilt_deg, range_m):
    pan, tilt = np.radians([pan_deg, tilt_deg])
    where = range_m * np.array([np.cos(tilt) * np.cos(pan), np.cos(tilt) * np.sin(pan), np.sin(tilt)])
    return Forecast(np.zeros(1), where[None], np.eye(3)[None], 0.0)


@pytest.mark.parametrize(
    ("people", "pan_deg", "tilt_deg"),
    [
        ([(10.0, 5.0, 2.0)], 10.0, 5.0),
        ([(-20.0, 0.0, 2.0), (40.0, 10.0, 4.0)], 10.0, 5.0),
        ([(-20.0, 0.0, 2.0), (39.0, 3.0, 2.0), (40.0, 10.0, 4.0)], 10.0, 5.0),  # the one between changes nothing
        ([(170.0, 0.0, 2.0), (-170.0, 0.0, 2.0)], 180.0, 0.0),
    ],
)
def test_the_middle_of_the_box(people, pan_deg, tilt_deg):
    x, y, z = middle_of([at(*each) for each in people]).means_base_m[0]
    off = np.degrees(np.arctan2(y, x)) - pan_deg
    assert (off + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-9)
    assert np.degrees(np.arctan2(z, np.hypot(x, y))) == pytest.approx(tilt_deg)
