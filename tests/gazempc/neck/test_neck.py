"""Necks: shipped parameters, command limits that bound the joint, and error messages."""

import re
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy import signal

from gazempc.errors import SettingsError
from gazempc.neck.servo import DelayedServo
from gazempc.neck.spec import Axis, NeckSpec, load_neck, neck_names
from gazempc.neck.speed_steps import SpeedSteps

REFERENCE_TOML = files("gazempc").joinpath("neck", "reference.toml").read_text(encoding="utf-8")


def axis(**changes):
    figures = {
        "position_min_deg": -10.0,
        "position_max_deg": 20.0,
        "velocity_max_rad_s": 5.0,
        "acceleration_max_rad_s2": 100.0,
        "jerk_max_rad_s3": 5000.0,
        "natural_frequency_rad_s": 12.0,
        "damping_ratio": 0.9,
        "dead_time_s": 0.0,
    }
    return Axis(**(figures | changes))


def neck_of(pan, tilt=None):
    return NeckSpec(name="test", source="test", pan=pan, tilt=tilt or pan)


# ---------------------------------------------------------------- shipped necks


@pytest.mark.parametrize("name", neck_names())
def test_every_shipped_neck_has_a_source_and_tighter_command_limits(name):
    neck = load_neck(name)
    assert neck.name == name
    assert len(neck.source) > 20
    limits = neck.command_limits
    assert np.all((limits.position_min_rad <= neck.rest_rad) & (neck.rest_rad <= limits.position_max_rad))
    assert np.all(neck.position_min_rad <= limits.position_min_rad)
    assert np.all(limits.position_max_rad <= neck.position_max_rad)
    for field in ("velocity_max_rad_s", "acceleration_max_rad_s2", "jerk_max_rad_s3"):
        assert np.all(getattr(limits, field) <= getattr(neck, field))


# ---------------------------------------------------------------- servo gain and command limits


@pytest.mark.parametrize(("zeta", "wn"), [(0.2, 3.0), (0.7, 12.0), (1.0, 12.0), (1.5, 12.0)])
def test_the_peak_gain_is_the_l1_norm_of_the_impulse_response(zeta, wn):
    times_s = np.linspace(0.0, 40.0 / wn / min(zeta, 0.4), 30_001)
    _, response = signal.impulse(([wn**2], [1.0, 2 * zeta * wn, wn**2]), T=times_s)
    integral = np.trapezoid(np.abs(response), times_s)
    assert axis(natural_frequency_rad_s=wn, damping_ratio=zeta).servo_gain == pytest.approx(integral, rel=1e-4)


def smooth(raw, neck):
    """A command within the limits of the first axis, from any signal in [-1, 1].

    A moving average over n samples of a signal in +-b changes by at most 2 b / n a sample; three of them bound
    velocity, acceleration and jerk, and none enlarges anything.
    """
    limits, dt = neck.command_limits, neck.servo_period_s
    centre = 0.5 * (limits.position_max_rad[0] + limits.position_min_rad[0])
    bound = 0.5 * (limits.position_max_rad[0] - limits.position_min_rad[0])
    command = bound * raw
    bounds = (limits.velocity_max_rad_s, limits.acceleration_max_rad_s2, limits.jerk_max_rad_s3)
    for limit in bounds:
        n = int(np.ceil(2.0 * bound / (limit[0] * dt)))
        bound = 2.0 * bound / (n * dt)
        # Constant before the start, so that the joint starts at rest at the command.
        command = np.convolve(np.concatenate([np.full(n - 1, command[0]), command]), np.full(n, 1.0 / n), "valid")
    for order, limit in enumerate(bounds, 1):
        assert np.all(np.abs(np.diff(command, order)) <= limit[0] * dt**order * (1 + 1e-6))
    return centre + command


def joint_that_follows(command, neck):
    servo = DelayedServo(neck.pan, float(command[0]))
    joint = []
    for k, u in enumerate(command):
        joint.append(servo.state[0])
        servo.send(float(u))
        servo.advance_to((k + 1) * neck.servo_period_s)
    return np.array(joint)


def excess(joint, neck):
    """Largest ratio of the joint's motion to its limits (1 is on the limit)."""
    centre = 0.5 * (neck.position_max_rad[0] + neck.position_min_rad[0])
    shares = [float(np.max(np.abs(joint - centre))) / float(neck.position_max_rad[0] - centre)]
    limits = (neck.velocity_max_rad_s[0], neck.acceleration_max_rad_s2[0], neck.jerk_max_rad_s3[0])
    for order, limit in enumerate(limits, start=1):
        shares.append(float(np.max(np.abs(np.diff(joint, order)))) / (limit * neck.servo_period_s**order))
    return max(shares)


@given(
    zeta=st.sampled_from([0.2, 0.4, 0.7, 0.9, 1.2]),
    jerk=st.sampled_from([300.0, 5000.0]),
    levels=st.lists(st.tuples(st.sampled_from([-1.0, 0.0, 1.0]), st.integers(5, 120)), min_size=2, max_size=12),
)
@example(zeta=0.2, jerk=5000.0, levels=[((-1.0) ** i, 53) for i in range(12)])
def test_commands_within_their_limits_keep_the_joint_within_its_limits(zeta, jerk, levels):
    neck = neck_of(axis(damping_ratio=zeta, jerk_max_rad_s3=jerk))
    raw = np.concatenate([np.full(ticks, level) for level, ticks in levels])
    assert excess(joint_that_follows(smooth(raw, neck), neck), neck) <= 1.0 + 1e-9


def test_the_command_limits_are_tight():
    """The worst-case command, switching at the servo's resonance, drives an underdamped joint to its limit."""
    neck = neck_of(axis(damping_ratio=0.3, velocity_max_rad_s=50.0, acceleration_max_rad_s2=1e4, jerk_max_rad_s3=1e7))
    half_period = round(np.pi / (12.0 * np.sqrt(1 - 0.3**2)) / neck.servo_period_s)
    raw = np.repeat([(-1.0) ** i for i in range(20)], half_period)
    assert 0.97 < excess(joint_that_follows(smooth(raw, neck), neck), neck) <= 1.0 + 1e-9


@pytest.mark.parametrize(("low", "high", "rests_at"), [(-10, 10, "0"), (15, 40, "low"), (-60, -20, "high")])
def test_rest_is_straight_ahead_clamped_to_the_limits(low, high, rests_at):
    neck = neck_of(axis(), axis(position_min_deg=low, position_max_deg=high, damping_ratio=0.5))
    limits = neck.command_limits
    expected = {"0": 0.0, "low": limits.position_min_rad[1], "high": limits.position_max_rad[1]}[rests_at]
    np.testing.assert_array_equal(neck.rest_rad, [0.0, expected])
    assert np.all((neck.position_min_rad <= neck.rest_rad) & (neck.rest_rad <= neck.position_max_rad))


# ---------------------------------------------------------------- bad files


def refusal(tmp_path, text):
    """Lines of the error for a file with this text; each must begin with the file's path."""
    path = tmp_path / "mine.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SettingsError) as caught:
        load_neck(path)
    lines = str(caught.value).splitlines()
    assert all(line.startswith(f"{path}: ") for line in lines)
    return [line.removeprefix(f"{path}: ") for line in lines]


def changed(*changes):
    """The reference file with the first occurrence of each text replaced."""
    text = REFERENCE_TOML
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text


@pytest.mark.parametrize("field", [name for name, field in Axis.model_fields.items() if field.is_required()])
def test_a_missing_value_is_reported_with_a_rule_of_thumb(tmp_path, field):
    text = re.sub(rf"^{field} = .*\n", "", REFERENCE_TOML, count=1, flags=re.MULTILINE)
    (line,) = refusal(tmp_path, text)
    assert re.match(rf"pan\.{field}: Field required; rule of thumb: \S", line)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (("dead_time_s = 0.4", 'dead_time_s = "long"'), r"pan\.dead_time_s: .*valid number.*\(given: 'long'\)"),
        (("dead_time_s = 0.4", "dead_time_s = -0.1"), r"pan\.dead_time_s: .*equal to 0 \(given: -0.1\)"),
        (("position_max_deg = 80.0", "position_max_deg = -80.0"), r"pan: .*\(-80\.0\) must be less than"),
        (("position_max_deg = 45.0", "position_max_deg = 4500"), r"tilt\.position_max_deg: .*360.*\(given: 4500\)"),
        (("[geometry]", "control_rate_hz = 60\n[geometry]"), r"\(whole file\): .*whole multiple of control_rate_hz"),
        (("[0.0, 0.0, 0.0]", "[0.0, 0.0]"), r"geometry\.tilt_axis_in_pan_m\.2: Field required"),
        (("[geometry]", "colour = 1\n[geometry]"), r"colour: unknown field; accepted: .*pan"),
        (("[tilt]", "[roll]"), r"roll: unknown field; .*accepted: .*tilt"),
    ],
)  # fmt: skip
def test_an_invalid_field_is_reported_with_the_reason(tmp_path, change, line):
    assert any(re.match(line, found) for found in refusal(tmp_path, changed(change)))


def test_an_unknown_name_is_refused_with_the_nearest_one():
    with pytest.raises(SettingsError, match=r"'referense'.*'reference'.*slow"):
        load_neck("referense")


def test_necks_are_equal_by_their_fields_alone():
    used, unused = load_neck("reference"), load_neck("reference")
    used.command_limits  # noqa: B018, arrays that are kept are no fields
    assert used == unused
    assert hash(used) == hash(unused)
    assert used != load_neck("slow")


def test_a_copy_with_other_limits_drops_cached_arrays():
    neck = load_neck("reference")
    assert np.degrees(neck.position_max_rad[0]) == pytest.approx(80.0)
    narrow = neck.model_copy(update={"pan": neck.pan.model_copy(update={"position_max_deg": 30.0})})
    assert np.degrees(narrow.position_max_rad[0]) == pytest.approx(30.0)
    assert narrow.command_limits.position_max_rad[0] < neck.command_limits.position_max_rad[0]
    with pytest.raises(ValidationError):
        neck.model_copy(update={"servo_rate_hz": 70.0})


def test_joints_are_named_in_the_order_of_the_arrays():
    neck = load_neck("reference_eyes")
    both = neck.model_copy(update={"body": neck.pan})
    assert both.joint_names == ("pan", "tilt", "eye_pan", "eye_tilt", "body_yaw")
    assert both.dead_time_s.tolist() == [0.4, 0.4, 0.06, 0.06, 0.4]
    slow = both.with_axes({"eye_tilt": both.eyes.tilt.model_copy(update={"dead_time_s": 0.1, "rest_deg": 10.0})})
    assert slow.dead_time_s.tolist() == [0.4, 0.4, 0.06, 0.1, 0.4]
    assert slow.rest_rad.tolist() == pytest.approx([0.0, 0.0, 0.0, np.deg2rad(10.0), 0.0])


# ---------------------------------------------------------------- speed tables


SPEEDS = st.lists(st.floats(1e-3, 10.0), min_size=1, max_size=20).map(lambda each: tuple(sorted(each)))


@given(SPEEDS, SPEEDS, st.floats(-12.0, 12.0))
def test_the_nearest_speed_step_minimises_the_distance(up, down, requested):
    steps = SpeedSteps(positive_rad_s=up, negative_rad_s=down)
    found = steps.step(requested)
    assert -len(down) <= found <= len(up)
    by_hand = 0.0 if found == 0 else up[found - 1] if found > 0 else -down[-found - 1]
    assert steps.speed_rad_s(found) == by_hand
    assert abs(by_hand - requested) == min(abs(speed - requested) for speed in (0.0, *up, *(-speed for speed in down)))


def test_a_speed_table_is_read_from_a_neck_file(tmp_path):
    steps = "speed_steps = { positive_rad_s = [0.1, 0.5, 1.4], negative_rad_s = [0.2, 1.5] }\n"
    text = files("gazempc.neck").joinpath("ptz.toml").read_text().replace("[tilt]", steps + "\n[tilt]")
    path = tmp_path / "own.toml"
    path.write_text(text)
    neck = load_neck(path)
    np.testing.assert_array_equal(neck.pan.speed_steps.levels_rad_s, [-1.5, -0.2, 0.0, 0.1, 0.5, 1.4])
    assert neck.pan.speed_steps.fastest_rad_s == 1.4
    assert neck.tilt.speed_steps is None
    assert neck.model_copy(update={"name": "copy"}).pan.speed_steps == neck.pan.speed_steps
    # The joint's top speed is available in both directions.
    path.write_text(text.replace("0.5, 1.4]", "0.5, 1.3]"))
    with pytest.raises(SettingsError, match="velocity_max_rad_s"):
        load_neck(path)
    path.write_text(text.replace('command = "velocity"', 'command = "position"', 1))
    with pytest.raises(SettingsError, match="velocity"):
        load_neck(path)


@pytest.mark.parametrize("wrong", [(), (0.2, 0.1), (0.0, 0.1), (-0.1, 0.1)])
def test_invalid_speed_tables_are_refused(wrong):
    with pytest.raises(ValidationError):
        SpeedSteps(positive_rad_s=(0.1,), negative_rad_s=wrong)
