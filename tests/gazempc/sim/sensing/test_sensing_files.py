"""Fields of sensor files, and the sensors that ship."""

import pytest
from builders.sensing import sensor

from gazempc.errors import SettingsError
from gazempc.sim.sensor import load_sensor

HEAD = 'name = "x"\nsource = "x"\nrate_hz = 30.0\nlatency_s = 0.0\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[along]\nnoise = 0.1\n", "along.noise: .*'noise_m'.*noise_s"),
        ("[sideways]\nnoise_m = 0.1\n", "sideways: .*across, along"),
        ("[loss]\nduration_min_s = 2\nduration_max_s = 1\n", "loss: duration_min_s"),
        ("[jumps]\nmean_interval_s = 2\n", "jumps: size_max_m .*mean_interval_s"),
        ("[jumps]\nsize_min_m = 2\n", "jumps: size_min_m .*size_max_m"),
        ("[other_person]\nevery_s = 1\nshown_s = 1\n", "other_person: shown_s .*every_s"),
    ],
)
def test_a_wrong_field_is_named_with_what_is_accepted(tmp_path, text, message):
    path = tmp_path / "wrong.toml"
    path.write_text(HEAD + text)
    with pytest.raises(SettingsError, match=f"wrong.toml: {message}"):
        load_sensor(path)


@pytest.mark.parametrize(
    ("fields", "depends"),
    [
        ({"position_noise_m": 0.1, "position_wander_m": 0.1, "yaw_noise_deg": 5.0}, False),
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
