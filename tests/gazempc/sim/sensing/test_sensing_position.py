"""Errors of positions and yaws: standard deviations, correlation and directions estimated from observations."""

from dataclasses import replace

import numpy as np
import pytest
from builders.sensing import HEAD_M, correlation, position_errors, seen, sensor, standing, yaw_errors

from gazempc.errors import SettingsError
from gazempc.sim.sensor import load_sensor

ALONG = HEAD_M / np.linalg.norm(HEAD_M)
LEFT = np.array([-ALONG[1], ALONG[0], 0.0])
RANGE_M = float(np.linalg.norm(HEAD_M))
LONG = standing(300.0)  # 9,000 frames: the s.d. of coloured noise is estimated to some per cent


def on_sight(errors):
    return errors @ ALONG, errors @ LEFT, errors[:, 2]


def test_wander_on_each_axis_has_its_sd_and_correlation_time():
    errors = position_errors(LONG, position_wander_m=0.025, position_wander_time_s=0.4)
    for axis in errors.T:
        assert axis.std() == pytest.approx(0.025, rel=0.1)
        for lag in (3, 12, 24):
            assert correlation(axis, lag) == pytest.approx(np.exp(-lag / 30 / 0.4), abs=0.08)
    assert np.corrcoef(errors.T) == pytest.approx(np.eye(3), abs=0.1)


def test_range_error_is_a_share_of_the_range_along_the_line_of_sight_only():
    share = {"noise_share": 0.035, "wander_share": 0.04, "wander_time_s": 2.0}
    along, left, up = on_sight(position_errors(LONG, along=share))
    assert along.std() == pytest.approx(RANGE_M * np.hypot(0.035, 0.04), rel=0.1)
    slow = 0.04**2 / (0.035**2 + 0.04**2)
    assert correlation(along, 1) == pytest.approx(slow * np.exp(-1 / 60), abs=0.1)
    assert correlation(along, 60) == pytest.approx(slow * np.exp(-1.0), abs=0.1)
    assert np.abs([left, up]).max() < 1e-12


def test_bearing_error_is_an_angle_on_both_axes_across():
    along, left, up = on_sight(position_errors(LONG, across={"noise_deg": 0.08}))
    assert np.abs(along).max() < 1e-12
    for axis in (left, up):
        assert np.degrees(axis.std() / RANGE_M) == pytest.approx(0.08, rel=0.04)
        assert correlation(axis, 1) == pytest.approx(0.0, abs=0.04)
    assert np.corrcoef(left, up)[0, 1] == pytest.approx(0.0, abs=0.04)


def test_jumps_have_the_stated_duration_rate_and_constant_offset():
    """Mean duration 0.3 s, mean pause 1.7 s: 15 % of the time."""
    jumps = {"mean_interval_s": 1.7, "duration_min_s": 0.1, "duration_max_s": 0.5, "size_min_m": 0.05}
    errors = position_errors(LONG, jumps=jumps | {"size_max_m": 0.12})
    size = np.linalg.norm(errors, axis=1)
    inside = size > 0
    assert inside.mean() == pytest.approx(0.15, abs=0.02)
    assert (size[inside].min(), size[inside].max()) == pytest.approx((0.05, 0.12), abs=0.008)
    values, lengths = np.unique(errors[inside], axis=0, return_counts=True)
    assert len(values) == pytest.approx(300 / 2.0, rel=0.15)
    assert 3 <= lengths.min() < lengths.max() <= 16
    # Equal counts in both directions of the three axes.
    assert (values > 0).mean(axis=0) == pytest.approx(0.5, abs=0.12)
    assert np.std(values, axis=0) == pytest.approx(0.0875 / np.sqrt(3), rel=0.2)


def test_a_jump_without_duration_lasts_one_frame():
    errors = position_errors(LONG, jumps={"mean_interval_s": 0.3, "size_min_m": 0.1, "size_max_m": 0.1, "level": True})
    hit = np.linalg.norm(errors, axis=1) > 0
    assert np.linalg.norm(errors[hit], axis=1) == pytest.approx(0.1)
    assert not errors[:, 2].any()
    # A frame is affected if an event falls between it and the previous one.
    assert hit.mean() == pytest.approx(1 - np.exp(-1 / 30 / 0.3), rel=0.1)
    assert len(np.unique(errors[hit], axis=0)) == hit.sum()


@pytest.mark.parametrize("ids", [False, True])
def test_another_person_is_reported_at_the_end_of_each_period(ids):
    """0.7 s of every 1.8 s, 0.8 m aside: 21 of 54 frames, with the errors of the sensor on top."""
    other = {"every_s": 1.8, "shown_s": 0.7, "aside_m": 0.8, "ids": ids}
    walk = standing(18.0)
    along, left, up = on_sight(position_errors(walk, other_person=other))
    shown = np.arange(540) % 54 >= 33
    assert left == pytest.approx(np.where(shown, 0.8, 0.0), abs=1e-9)
    assert np.abs([along, up]).max() < 1e-9
    names = [o.person_id for o in seen(walk, other_person=other)]
    assert names == [("2" if one else "1") if ids else None for one in shown]
    noisy, plain = (position_errors(walk, position_noise_m=0.01, **more) for more in ({"other_person": other}, {}))
    assert noisy - plain == pytest.approx(0.8 * shown[:, None] * LEFT / np.linalg.norm(LEFT), abs=1e-9)


def test_the_stated_covariance_equals_that_of_the_errors():
    fields = {"along": {"noise_share": 0.035, "wander_share": 0.02, "wander_time_s": 0.1}, "states_covariance": True}
    observations = seen(LONG, across={"noise_deg": 0.5}, **fields)
    for each in observations[:20]:
        values, vectors = np.linalg.eigh(each.position_covariance_m2)
        measured = each.head_position_base_m
        assert abs(vectors[:, 2] @ measured) == pytest.approx(np.linalg.norm(measured))
        range_m = np.linalg.norm(measured)
        assert values[2] == pytest.approx((range_m**2) * (0.035**2 + 0.02**2))
        assert values[:2] == pytest.approx((range_m * np.deg2rad(0.5)) ** 2)
    errors = np.array([o.head_position_base_m for o in observations]) - HEAD_M
    stated = np.mean([o.position_covariance_m2 for o in observations], axis=0)
    assert np.cov(errors.T) == pytest.approx(stated, abs=0.08 * stated.max())


def test_covariances_are_optional_and_require_errors():
    assert seen(standing(1.0), position_noise_m=0.01)[0].position_covariance_m2 is None
    each = seen(standing(1.0), position_noise_m=0.03, position_wander_m=0.04, states_covariance=True)[0]
    assert each.position_covariance_m2 == pytest.approx(0.0025 * np.eye(3))
    with pytest.raises(ValueError, match="states_covariance needs an error across the line of sight"):
        sensor(states_covariance=True, along={"noise_m": 0.1})


def test_errors_of_different_kinds_and_recordings_are_independent():
    walk = standing(60.0)
    on_sight = position_errors(walk, along={"noise_m": 0.1}) @ ALONG
    on_axes = position_errors(walk, position_wander_m=0.1, position_wander_time_s=1e-3)
    turns = {part: yaw_errors(walk, part=part, **{f"{part}_yaw": {"noise_deg": 5.0}}) for part in ("head", "pelvis")}
    other = position_errors(replace(walk, name="another"), along={"noise_m": 0.1}) @ ALONG
    # Independent ones of 1800 frames correlate by 0.024 (s.d.).
    draws = np.stack([on_sight, other, *on_axes.T, *turns.values()])
    assert np.corrcoef(draws) == pytest.approx(np.eye(len(draws)), abs=0.12)


@pytest.mark.parametrize("head_m", [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
def test_a_head_at_the_sensor_or_straight_above_it_has_finite_errors(head_m):
    walk = standing(1.0, np.array(head_m))
    for each in seen(walk, along={"noise_m": 0.01}, across={"noise_m": 0.01}, states_covariance=True):
        assert np.isfinite(each.head_position_base_m).all()
        assert each.position_covariance_m2 == pytest.approx(1e-4 * np.eye(3))


HEAD = {"noise_deg": 2.0, "wander_deg": 8.0, "wander_time_s": 0.8}
PELVIS = {"noise_deg": 1.0, "wander_deg": 6.0, "wander_time_s": 0.3}


def test_each_yaw_has_its_own_white_error_and_wander():
    for part, error in (("head", HEAD), ("pelvis", PELVIS)):
        found = np.degrees(yaw_errors(LONG, part, head_yaw=HEAD, pelvis_yaw=PELVIS))
        variance = error["noise_deg"] ** 2 + error["wander_deg"] ** 2
        assert found.std() == pytest.approx(np.sqrt(variance), rel=0.1)
        for lag in (1, 12):
            expected = error["wander_deg"] ** 2 / variance * np.exp(-lag / 30 / error["wander_time_s"])
            assert correlation(found, lag) == pytest.approx(expected, abs=0.08)


def test_yaw_flips_and_losses_occur_only_facing_away():
    """Turning on the spot; of the time facing away a quarter is flipped and an eighth is lost."""
    angle_deg = np.rad2deg(np.linspace(0.0, 2 * np.pi * 50, 300 * 30))
    walk = standing(300.0, facing_away_deg=angle_deg)
    away = np.abs((angle_deg + 180.0) % 360.0 - 180.0) > 120.0
    fate = {"away_deg": 120.0, "lost_share": 0.125, "flipped_share": 0.25, "hold_s": 0.3}
    errors = yaw_errors(walk, pelvis_yaw=fate, part="pelvis")
    lost, flipped = np.isnan(errors), np.abs(np.abs(errors) - np.pi) < 1e-6
    assert not (lost | flipped)[~away].any()
    assert lost[away].mean() == pytest.approx(0.125, abs=0.03)
    assert flipped[away].mean() == pytest.approx(0.25, abs=0.04)
    assert np.abs(errors[~lost & ~flipped]).max() < 1e-9
    assert not np.isnan(yaw_errors(walk, pelvis_yaw=fate, part="head")).any()


def test_flips_have_the_stated_mean_duration():
    walk = standing(300.0, facing_away_deg=180.0)
    flipped = np.abs(yaw_errors(walk, head_yaw={"flipped_share": 0.5, "hold_s": 0.5})) > 3.0
    # Half of the draws change the state: a state lasts twice the mean time between draws.
    changes = np.count_nonzero(np.diff(flipped.astype(int)))
    per_frame = 1 - np.exp(-1 / 30 / 0.5)
    assert changes == pytest.approx(300 * 30 * per_frame / 2, rel=0.1)


def test_stated_yaw_deviations_combine_white_error_and_wander():
    away = standing(20.0, facing_away_deg=180.0)
    yaws = {"head_yaw": {"wander_deg": 4.0, "lost_share": 0.5}, "pelvis_yaw": {"reported": False}}
    observations = seen(away, 0, states_covariance=True, position_noise_m=0.01, yaw_noise_deg=2.0, **yaws)
    for each in observations:
        assert each.pelvis_yaw_sd_rad is None
        stated = None if each.head_quat_wxyz is None else pytest.approx(np.radians(np.sqrt(20.0)))
        assert each.head_yaw_sd_rad == stated
    assert {each.head_quat_wxyz is None for each in observations} == {True, False}


# ---------------------------------------------------------------- files


TOML = 'name = "x"\nsource = "x"\nrate_hz = 30.0\nlatency_s = 0.0\n'


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
def test_an_invalid_field_is_reported_with_the_accepted_values(tmp_path, text, message):
    path = tmp_path / "wrong.toml"
    path.write_text(TOML + text)
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
def test_dependence_on_the_robot_position_is_detected(fields, depends):
    assert sensor(**fields).depends_on_place is depends
