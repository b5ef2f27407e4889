"""What sensors saw of a walk: errors and forecasts known beforehand, and a picture of each."""

import numpy as np
import pytest
from builders.pages import ROOT
from builders.recordings import synthetic

from experiments.sensor_example import main, see
from gazempc.sim.sensor import load_sensor
from predictors import Forecast, NotReadyError

FILES = sorted((ROOT / "experiments/studies/sensors").glob("*.toml"))


def sensor(**fields):
    return load_sensor("perfect").model_copy(update=fields)


class Newest:
    """Forecasts the newest head for ever, 0.2 m and 0.1 m unsure; has seen what it says."""

    def __init__(self, degrees_of_freedom=np.inf):
        self.degrees_of_freedom = degrees_of_freedom

    def reset(self):
        self.seen = None

    def update(self, observation):
        self.seen = observation

    def forecast(self, times_s):
        if self.seen is None:
            raise NotReadyError("nobody yet")
        count = len(times_s)
        covariance = np.tile(np.diag([0.04, 0.01, 1.0]), (count, 1, 1))
        mean = np.tile(self.seen.head_position_base_m, (count, 1))
        return Forecast(times_s, mean, covariance, self.seen.capture_time_s, self.degrees_of_freedom)


def test_forecasts_come_from_what_has_arrived_and_are_held_against_the_truth():
    walk = synthetic("subject03_R4")
    for at_s in (1.0, 2.0):
        seen = see(walk, sensor(latency_s=0.25), Newest(), at_s, seed=0)
        # A frame every 1/30 s, 0.25 s late: the newest is from 0.75 s to 0.75 s + 1/30 s before.
        newest = np.flatnonzero(walk.times_s <= at_s - 0.25 + 1e-9)[-1]
        np.testing.assert_allclose(seen.means_base_m, np.tile(walk.truth.head_position_m[newest, :2], (3, 1)))
        np.testing.assert_allclose(seen.true_base_m, seen.truth(at_s + np.array([0.25, 0.5, 1.0]))[:, :2])
    assert seen.error_rms_mm() == pytest.approx((0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize(
    ("freedom", "radius"),
    # Of chi-square(2) the 95 % quantile is -2 ln 0.05; of F(2, 4) it is 6.944, which is to be times 2 (4 - 2) / 4.
    [(np.inf, np.sqrt(-2.0 * np.log(0.05))), (4.0, np.sqrt(6.944))],
)
def test_the_ellipse_from_above_is_that_of_the_stated_tails(freedom, radius):
    seen = see(synthetic("subject03_R4"), sensor(), Newest(freedom), 1.0, seed=0)
    assert seen.radius == pytest.approx(radius, rel=1e-3)
    np.testing.assert_allclose(seen.covariances_m2[0], np.diag([0.04, 0.01]))


@pytest.mark.slow
def test_one_picture_has_a_panel_for_each_sensor(tmp_path, capsys):
    chosen = ["reference", "face_camera"]
    options = ["--predictor", "constant_velocity", "--at-s", "1.5", "--out", str(tmp_path)]
    assert main(["--replay", "subject03_R1", "--sensors", *chosen, *options]) == 0
    assert [p.name for p in tmp_path.iterdir()] == ["all_sensors.png"]
    assert min(p.stat().st_size for p in tmp_path.iterdir()) > 20_000
    printed = capsys.readouterr().out
    assert "subject03_R1 (synthetic)" in printed
    assert all(name in printed for name in chosen)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--at-s", "0.0"], "sensor 'reference' had no observation yet"),
        (["--at-s", "60"], r"accepted: 0 to"),
        (["--sensors", "nothing"], "nothing"),
    ],
)
def test_bad_input_is_named(tmp_path, capsys, arguments, message):
    shown = ["--predictor", "constant_velocity", "--replay", "subject03_R1", "--out", str(tmp_path)]
    assert main([*shown, "--sensors", "reference", *arguments]) == 2
    assert message in capsys.readouterr().err


# What tells each sensor of the page from the one it is compared with.
PROPERTIES = {
    "ten_fps": ("reference", {"rate_hz"}),
    "late": ("reference", {"latency_s", "timing"}),
    "lost": ("reference", {"loss"}),
    "positions_only": ("reference", {"head_yaw", "pelvis_yaw", "yaw_noise_deg"}),
    "silent_camera": ("face_camera", {"states_covariance"}),
    "slow_range": ("reference", {"along"}),
    "steady": ("reference", {"rate_hz", "latency_s"}),
}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_sensors_of_the_page_differ_in_one_property(path):
    assert sorted(PROPERTIES) == [each.stem for each in FILES]
    other, properties = PROPERTIES[path.stem]
    found, expected = load_sensor(path).model_dump(), load_sensor(other).model_dump()
    assert found["name"] == path.stem
    assert {name for name in found if found[name] != expected[name]} - {"name", "source"} == properties
