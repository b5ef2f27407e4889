"""Fields of sensor files, and the sensors that ship."""

import pytest
from builders.sensing import sensor

from gazempc.errors import SettingsError
from gazempc.sim.sensor import load_sensor

HEAD = 'name = "x"\nsource = "x"\nrate_hz = 30.0\nlatency_s = 0.0\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[along]\nnoise = 0.1\n",
            "along.noise: unknown field; perhaps you meant 'noise_m'; accepted: noise_m, noise_s",
        ),
        ("[sideways]\nnoise_m = 0.1\n", "sideways: unknown field; .*accepted: across, along, dropout_probability, "),
        ("[loss]\nduration_min_s = 2\nduration_max_s = 1\n", r"loss: duration_min_s \(2.0\) must not be more than"),
        ("[jumps]\nmean_interval_s = 2\n", "jumps: size_max_m must be more than 0 where mean_interval_s is given"),
        ("[jumps]\nsize_min_m = 2\n", r"jumps: size_min_m \(2.0\) must not be more than size_max_m"),
        ("[other_person]\nevery_s = 1\nshown_s = 1\n", r"other_person: shown_s \(1.0\) must be less than every_s"),
    ],
)
def test_a_wrong_field_is_named_with_what_is_accepted(tmp_path, text, message):
    path = tmp_path / "wrong.toml"
    path.write_text(HEAD + text)
    with pytest.raises(SettingsError, match=f"wrong.toml: {message}"):
        load_sensor(path)


def test_shipped_sensors_have_the_figures_of_the_design():
    tracker, kinect, face, street = (load_sensor(n) for n in ("body_tracker", "azure_kinect", "face_camera", "street"))
    assert (tracker.position_noise_m, tracker.position_wander_m, tracker.position_wander_time_s) == (0.006, 0.025, 0.4)
    head, pelvis = tracker.head_yaw, tracker.pelvis_yaw
    assert (head.noise_deg, head.wander_deg, head.wander_time_s) == (2.0, 8.0, 0.8)
    assert (pelvis.noise_deg, pelvis.wander_deg, pelvis.wander_time_s) == (2.0, 6.0, 0.8)
    assert (tracker.rate_hz, tracker.latency_s) == (30.0, 0.066)
    same = set(type(kinect).model_fields) - {"name", "source", "latency_s", "range_min_m", "range_max_m", "view"}
    assert {n for n in same if getattr(kinect, n) != getattr(tracker, n)} == set()
    assert (kinect.latency_s, kinect.range_min_m, kinect.range_max_m) == (0.25, 0.5, 5.46)
    assert (face.along.noise_share, face.along.wander_share, face.along.wander_time_s) == (0.035, 0.04, 2.0)
    assert (face.across.noise_deg, face.across.wander_deg, face.head_yaw.noise_deg) == (0.08, 0.0, 4.0)
    assert (face.states_covariance, face.pelvis_yaw.reported) == (True, False)
    assert (street.rate_hz, street.head_yaw.reported, street.pelvis_yaw.reported) == (50.0, False, False)


@pytest.mark.parametrize(
    ("fields", "depends"),
    [
        ({}, False),
        ({"position_noise_m": 0.1, "position_wander_m": 0.1, "yaw_noise_deg": 5.0}, False),
        ({"jumps": {"mean_interval_s": 1.0, "size_max_m": 0.1}, "loss": {"mean_interval_s": 1.0}}, False),
        ({"head_yaw": {"noise_deg": 4.0, "away_deg": 30.0}, "pelvis_yaw": {"reported": False}}, False),
        ({"along": {"wander_time_s": 3.0}}, False),
        ({"other_person": {"ids": True, "shown_s": 1.0}}, False),
        ({"other_person": {"every_s": 2.0, "shown_s": 1.0}}, True),
        ({"along": {"noise_m": 0.1}}, True),
        ({"across": {"wander_deg": 0.1}}, True),
        ({"range_max_m": 5.0}, True),
        ({"view": {"vertical_deg": 60.0}}, True),
        ({"pelvis_yaw": {"flipped_share": 0.1}}, True),
    ],
)
def test_what_depends_on_the_robots_place(fields, depends):
    assert sensor(**fields).depends_on_place is depends
