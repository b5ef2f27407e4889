"""Speed tables of joints: levels, nearest steps, and refused tables."""

from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from gazempc.errors import SettingsError
from gazempc.neck.spec import load_neck
from gazempc.neck.speed_steps import SpeedSteps

SPEEDS = st.lists(st.floats(1e-3, 10.0), min_size=1, max_size=20).map(lambda each: tuple(sorted(each)))


@given(SPEEDS, SPEEDS, st.floats(-12.0, 12.0))
def test_the_nearest_step_is_nearer_than_all_others(up, down, wanted):
    steps = SpeedSteps(positive_rad_s=up, negative_rad_s=down)
    found = steps.step(wanted)
    assert -len(down) <= found <= len(up)
    by_hand = 0.0 if found == 0 else up[found - 1] if found > 0 else -down[-found - 1]
    assert steps.speed_rad_s(found) == by_hand
    assert abs(by_hand - wanted) == min(abs(speed - wanted) for speed in (0.0, *up, *(-speed for speed in down)))


def test_a_table_in_a_neck_file(tmp_path):
    steps = "speed_steps = { positive_rad_s = [0.1, 0.5, 1.4], negative_rad_s = [0.2, 1.5] }\n"
    text = files("gazempc.neck").joinpath("ptz.toml").read_text().replace("[tilt]", steps + "\n[tilt]")
    path = tmp_path / "own.toml"
    path.write_text(text)
    neck = load_neck(path)
    np.testing.assert_array_equal(neck.pan.speed_steps.levels_rad_s, [-1.5, -0.2, 0.0, 0.1, 0.5, 1.4])
    assert neck.pan.speed_steps.fastest_rad_s == 1.4
    assert neck.tilt.speed_steps is None
    assert neck.model_copy(update={"name": "copy"}).pan.speed_steps == neck.pan.speed_steps
    # The top speed of the joint is one that the device has in both directions.
    path.write_text(text.replace("0.5, 1.4]", "0.5, 1.3]"))
    with pytest.raises(SettingsError, match="velocity_max_rad_s"):
        load_neck(path)
    path.write_text(text.replace('command = "velocity"', 'command = "position"', 1))
    with pytest.raises(SettingsError, match="velocity"):
        load_neck(path)


@pytest.mark.parametrize("wrong", [(), (0.2, 0.1), (0.0, 0.1), (-0.1, 0.1)])
def test_refused_tables(wrong):
    with pytest.raises(ValidationError):
        SpeedSteps(positive_rad_s=(0.1,), negative_rad_s=wrong)
