"""Rivals as the trials make them."""

import inspect

import pytest
from builders.rival_bench import CAMERA

from experiments.rivals.jobs import calibrate
from experiments.rivals.laws import RIVALS
from gazempc.neck.spec import load_neck


def test_the_calibration_finds_the_top_speed_of_a_neck():
    """Half the field of view takes its angle over the top speed; large moves come to rest later than small ones."""
    neck = load_neck("reachy_mini")
    found = calibrate(neck, CAMERA)
    least_s = CAMERA.half_width_rad / neck.pan.velocity_max_rad_s
    assert least_s < found.slope_s < 1.6 * least_s
    assert neck.pan.dead_time_s < found.offset_s < 0.6
    assert found.zero_move_s < 0.05


@pytest.mark.parametrize("law", [law for law in RIVALS.values() if law.free != ({},)])
def test_free_constants_are_keywords_and_the_default_is_tried(law):
    parameters = inspect.signature(law).parameters
    own = {name: parameters[name].default for name in law.free[0]}
    assert own in law.free
    assert all(constants.keys() == own.keys() for constants in law.free)
    assert len({tuple(constants.items()) for constants in law.free}) == len(law.free)
