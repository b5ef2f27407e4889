"""The MuJoCo neck against closed-form responses, and against the plain simulation of the same neck."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from builders.robots import with_both
from scipy import signal

from gazempc.errors import RobotError
from gazempc.identify.identify import main as identify
from gazempc.live.session import main as live
from gazempc.neck.kinematics import gaze_ray
from gazempc.neck.spec import Geometry, load_neck
from gazempc.robots.mujoco import MujocoNeck, neck_mjcf
from gazempc.sim.simulated import SimulatedNeck

NECK = load_neck("reference")
GEOMETRY = Geometry(tilt_axis_in_pan_m=(0.07, 0.01, 0.05), eye_in_tilt_m=(0.06, -0.03, 0.08))


class Clock:
    def __init__(self, time_s=0.0):
        self.time_s = time_s

    def __call__(self):
        return self.time_s


def chain(eyes=True, body=True, offset=False):
    """The reference neck with the joints beside pan and tilt, perhaps with the eye off the axes."""
    parts = {"eyes": load_neck("reference_eyes").eyes} if eyes else {}
    parts |= {"body": load_neck("reachy_mini_body").body} if body else {}
    parts |= {"geometry": GEOMETRY} if offset else {}
    return NECK.model_copy(update=parts)


def mujoco_neck(neck, clock, start_rad=(0.0, 0.0), seed=0):
    return MujocoNeck(neck, clock, np.array(start_rad), seed)


def simulated_neck(neck, clock, start_rad=(0.0, 0.0), seed=0):
    return SimulatedNeck(neck, np.array(start_rad), clock, seed)


def drive(make, neck, command, seconds, start_rad=(0.0, 0.0), origin_s=0.0):
    """Send `command(t)` at every servo tick; times and true positions, shapes (T,) and (T, 2)."""
    clock = Clock(origin_s)
    robot = make(neck, clock, start_rad)
    robot.connect()
    times = np.arange(round(seconds / neck.servo_period_s)) * neck.servo_period_s
    positions = []
    for t in times:
        clock.time_s = origin_s + t
        state = robot.true_state()
        assert state.time_s == clock.time_s
        positions.append(state.position_rad)
        robot.send_command(np.asarray(command(t), dtype=float))
    robot.close()
    return times, np.array(positions)


def rms_deg(a, b):
    return np.rad2deg(np.sqrt(np.mean((a - b) ** 2)))


@pytest.mark.parametrize(("damping_ratio", "dead_time_s"), [(0.4, 0.4), (0.9, 0.0), (3.0, 0.4)])
def test_a_step_gives_the_delayed_second_order_response(damping_ratio, dead_time_s):
    neck = with_both(NECK, damping_ratio=damping_ratio, dead_time_s=dead_time_s)
    step_rad = np.deg2rad([30.0, -20.0])
    times, positions = drive(mujoco_neck, neck, lambda t: step_rad, 3.0)
    for i, axis in enumerate(neck.axes):
        wn = axis.natural_frequency_rad_s
        system = signal.TransferFunction([wn**2], [1.0, 2 * damping_ratio * wn, wn**2])
        fine = np.arange(3000) * 1e-3
        _, response = signal.step(system, T=fine)
        expected = step_rad[i] * np.interp(times - dead_time_s, fine, response, left=0.0)
        # A delayed step is a ramp of one simulation step.
        assert np.rad2deg(np.abs(positions[:, i] - expected).max()) < 0.01
        assert np.all(positions[times < dead_time_s, i] == 0.0)


def test_pan_inertia_follows_the_parallel_axis_theorem():
    """Tilted up by 45 deg, the head's mass is nearer to the pan axis; the plain simulation has constant inertia."""
    reach_m, tilt_rad = 0.4, np.deg2rad(45.0)
    geometry = Geometry(eye_in_tilt_m=(reach_m, 0.0, 0.0))
    neck = with_both(NECK, dead_time_s=0.0).model_copy(update={"geometry": geometry})
    wn, zeta = neck.pan.natural_frequency_rad_s, neck.pan.damping_ratio
    times, positions = drive(mujoco_neck, neck, lambda t: (0.5, tilt_rad), 2.0, (0.0, tilt_rad))
    # Head 1 kg, gears 0.1 kg m^2; plus inertia of ball and yoke. The servo's gains are for tilt 0.
    other_kg_m2 = 0.1 + 0.001 + 0.4 * 0.09**2
    share = (other_kg_m2 + (reach_m * np.cos(tilt_rad)) ** 2) / (other_kg_m2 + reach_m**2)
    fine = np.arange(2000) * 1e-3
    expected, ours = (
        0.5
        * np.interp(times, fine, signal.step(signal.TransferFunction([wn**2], [j, 2 * zeta * wn, wn**2]), T=fine)[1])
        for j in (share, 1.0)
    )
    assert np.rad2deg(np.abs(positions[:, 0] - expected).max()) < 0.15
    assert np.rad2deg(np.abs(positions[:, 0] - ours).max()) > 1.0


def test_the_joints_stop_at_the_ends_of_their_range():
    """Lightly damped servos at the end of the range would overshoot by 50 %; end stops prevent it."""
    neck = with_both(NECK, damping_ratio=0.2, dead_time_s=0.1)
    _, free = drive(simulated_neck, neck, lambda t: neck.position_max_rad, 3.0)
    _, stopped = drive(mujoco_neck, neck, lambda t: neck.position_max_rad, 3.0)
    over_deg = np.rad2deg((stopped - neck.position_max_rad).max(axis=0))
    assert np.all(np.rad2deg((free - neck.position_max_rad).max(axis=0)) > 20.0)
    assert np.all(over_deg < 1.0), over_deg
    assert stopped[-1] == pytest.approx(neck.position_max_rad, abs=1e-3)


def test_a_load_shifts_the_steady_state_and_encoders_have_noise():
    loads = {"pan": {"load_offset_deg": 2.0}, "tilt": {"load_offset_deg": -1.0, "encoder_noise_deg": 0.1}}
    neck = NECK.with_axes({name: getattr(NECK, name).model_copy(update=load) for name, load in loads.items()})
    _, positions = drive(mujoco_neck, neck, lambda t: (0.3, 0.2), 3.0)
    assert np.rad2deg(positions[0]) == pytest.approx([2.0, -1.0])
    assert np.rad2deg(positions[-1] - [0.3, 0.2]) == pytest.approx([2.0, -1.0], abs=1e-6)
    robots = [mujoco_neck(neck, Clock(), seed=seed) for seed in (1, 1, 2)]
    for robot in robots:
        robot.connect()
    read = np.array([[robot.read_state().position_rad for _ in range(2000)] for robot in robots])
    assert np.array_equal(read[0], read[1])
    assert not np.array_equal(read[0], read[2])
    assert np.rad2deg(read.std(axis=1)) == pytest.approx(np.tile([0.0, 0.1], (3, 1)), abs=0.005)


def test_the_state_is_held_between_steps_and_commands_are_clamped():
    clock = Clock(5.0)
    robot = mujoco_neck(NECK, clock)
    robot.connect()
    assert np.array_equal(robot.send_command(np.array([9.0, -9.0])), [np.deg2rad(80), np.deg2rad(-35)])
    for clock.time_s in (5.0104, 5.0109, 5.3007):
        state = robot.read_state()
        assert state.time_s == pytest.approx(5.0 + 0.001 * int((clock.time_s - 5.0) / 0.001))
    for clock.time_s in (5.2, np.nan):
        with pytest.raises(RobotError, match="backwards"):
            robot.read_state()
    clock.time_s = 8.0
    assert robot.true_state().position_rad == pytest.approx(np.deg2rad([80.0, -35.0]), abs=1e-3)
    for bad in (np.nan, np.inf):
        with pytest.raises(RobotError, match="refused"):
            robot.send_command(np.array([0.0, bad]))


@pytest.mark.parametrize(
    "neck", [chain(e, b, True) for e in (False, True) for b in (False, True)], ids=lambda n: n.joints
)
def test_the_camera_pose_equals_the_kinematics(neck):
    """The camera's pose by MuJoCo's kinematics, for all offsets and sets of joints."""
    model = mujoco.MjModel.from_xml_string(neck_mjcf(neck))
    data = mujoco.MjData(model)
    for angles in np.random.default_rng(0).uniform(-1.2, 1.2, (20, neck.joints)):
        for name, angle in zip(neck.joint_names, angles, strict=True):
            data.joint(name).qpos[0] = angle
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        eye, direction = gaze_ray(GEOMETRY, angles)
        assert data.camera("eye").xpos == pytest.approx(eye, abs=1e-12)
        # A camera looks along its -z, with +y up: never rolled in the head, whose eyes may roll it.
        axes = data.camera("eye").xmat.reshape(3, 3)
        assert -axes[:, 2] == pytest.approx(direction, abs=1e-12)
        if neck.eyes is None:
            assert axes[2, 0] == pytest.approx(0.0, abs=1e-12)


def test_eyes_and_body_respond_as_in_the_plain_simulation():
    """Each joint has its own dead time and servo; coupling is small."""
    neck = chain()
    rates = np.array([1.3, 1.7, 5.0, 4.0, 0.7])

    def command(t):
        return np.array([0.5, 0.2, 0.3, 0.2, 0.8]) * np.sin(rates * t)

    _, own = drive(simulated_neck, neck, command, 4.0, np.zeros(5))
    _, other = drive(mujoco_neck, neck, command, 4.0, np.zeros(5))
    assert np.ptp(own, axis=0).min() > 0.3
    for i in range(neck.joints):
        assert rms_deg(own[:, i], other[:, i]) < 0.06, neck.joint_names[i]


@pytest.mark.slow
def test_the_loop_with_an_identified_model_matches_the_plain_simulation(tmp_path):
    """The model of the MuJoCo neck is identified from its motion: error within 10 % of the plain simulation."""

    def gaze_error_deg(robot, neck):
        out = tmp_path / f"{robot}_{Path(neck).stem}"
        words = ["--source", "replay", "--simulated-clock", "--no-figures", "--robot", robot, "--neck", neck]
        words += ["--controller", "lookahead", "--log", "npz", "--duration-s", "3"]
        assert live(["--out", str(out), *words]) == 0
        summary = json.loads((out / "summary.json").read_text())
        assert summary["limit_violations"] == 0
        return summary["metrics_of_last_log"]["gaze_error_rms_deg"]

    measured = tmp_path / "measured.toml"
    assert identify(["--robot", "mujoco", "--duration-s", "8", "--out", str(measured)]) == 0
    own, identified = gaze_error_deg("simulated", "reference"), gaze_error_deg("mujoco", str(measured))
    assert own < 2.0
    assert identified == pytest.approx(own, rel=0.1)
