"""A controller, a smoother and a neck in closed loop."""

import numpy as np

from gazempc.controllers.controller import CommandState, Situation
from gazempc.loop.joints import FollowingWatch
from gazempc.loop.observer import JointObserver
from gazempc.loop.smoother import Smoother
from gazempc.neck.ahead import joints_after_dead_time
from gazempc.neck.kinematics import gaze_error_rad
from gazempc.neck.spec import load_neck
from gazempc.sim.simulated import SimulatedNeck
from predictors import Forecast

NECK = load_neck("reference")


def forecast(times_s, path, sigma_m=np.zeros_like, issued_at_s=0.0):
    times = np.asarray(times_s)
    return Forecast(times, path(times), sigma_m(times)[:, None, None] ** 2 * np.eye(3), issued_at_s)


def at_rest(neck, known, command_rad=None, start_s=0.0, offset_rad=None, **changes):
    """A situation with the joints at rest at their commands; angles of all joints, by default 0."""
    zero = np.zeros(neck.joints)
    command_rad, offset_rad = (zero if each is None else np.asarray(each) for each in (command_rad, offset_rad))
    values = {
        "forecast": known,
        "command": CommandState(command_rad, zero, zero),
        "joint_position_rad": command_rad + offset_rad,
        "joint_velocity_rad_s": zero,
        "joint_offset_rad": offset_rad,
        "sent_rad": np.tile(command_rad, (200, 1)),
        "committed_rad": np.zeros((0, neck.joints)),
    }
    return Situation(joints_after_dead_time(neck, 0), start_s, **(values | changes))


def run(
    controller,
    neck,
    path,
    ticks,
    start_rad=(0.0, 0.0),
    model=None,
    known=None,
    sigma_m=np.zeros_like,
    robot_type=SimulatedNeck,
):
    """Simulate the closed loop; returns true joint angles, commands and the gaze error after each tick.

    The forecast is the true future or `known(now, times)`, with standard deviations `sigma_m` of the time
    from now. `neck` is the plant; `model` is the
    model of controller, observer and smoother.
    """
    model = model or neck
    now = 0.0
    observer = JointObserver(model, np.array(start_rad), 0.0)
    smoother = Smoother(model, np.array(start_rad))
    following = FollowingWatch(model)
    robot = robot_type(neck, smoother.command.position_rad, lambda: now)
    robot.connect()
    sent = np.tile(smoother.command.position_rad, (400, 1))
    plan, joints, commands = None, [], []
    for k in range(ticks):
        now = k * neck.servo_period_s
        true = robot.true_state()
        measured = robot.read_state()
        following.measured(measured)
        if k % neck.servo_ticks_per_plan == 0 and neck.joints > 2:
            following.judge()
        observer.update(now, measured, following.held)
        state = observer.estimate
        if k % neck.servo_ticks_per_plan == 0:
            situation = Situation(
                joints_after_dead_time(model, 0),
                start_s=now,
                forecast=forecast(
                    controller.forecast_times_s(now, now),
                    path if known is None else lambda t, now=now: known(now, t),
                    lambda t, now=now: sigma_m(t - now),
                    now,
                ),
                command=smoother.command,
                joint_position_rad=state.position_rad,
                joint_velocity_rad_s=state.velocity_rad_s,
                joint_offset_rad=state.offset_rad,
                sent_rad=sent,
                committed_rad=np.zeros((0, neck.joints)),
                held=following.held,
            )
            plan = controller.plan(situation)
        command_rad = smoother.step(now, plan)
        sent = np.roll(sent, -1, axis=0)
        sent[-1] = robot.send_command(command_rad)
        observer.sent(sent[-1])
        following.sent(sent[-1])
        joints.append(true.position_rad)
        commands.append(command_rad)
    joints = np.array(joints)
    errors = gaze_error_rad(neck.geometry, joints, path(neck.servo_period_s * np.arange(ticks)))
    return joints, np.array(commands), np.rad2deg(errors)


def assert_within(limits, positions, period_s):
    """Positions, starting at rest, are within the limits of position, velocity, acceleration and jerk."""
    x = np.vstack([np.tile(positions[0], (3, 1)), positions])
    assert np.all(x <= limits.position_max_rad + 1e-9)
    assert np.all(x >= limits.position_min_rad - 1e-9)
    bounds = limits.velocity_max_rad_s, limits.acceleration_max_rad_s2, limits.jerk_max_rad_s3
    for order, bound in enumerate(bounds, start=1):
        # Differences of angles carry 1e-16 / period^order of rounding.
        peak = np.abs(np.diff(x, order, axis=0)).max(axis=0) / period_s**order
        assert np.all(peak <= bound * (1 + 1e-6) + 1e-13 / period_s**order), f"derivative {order}"


def crossing(times):
    """A person who walks past at 1.2 m/s, 2.5 m away."""
    times = np.asarray(times)
    return np.stack([np.full_like(times, 2.5), 1.5 - 1.2 * times, np.full_like(times, 0.4)], axis=-1)


def still(angle_rad, distance_m=2.5):
    """A person who stands still at an angle."""

    def path(times):
        return np.tile(
            [distance_m * np.cos(angle_rad), distance_m * np.sin(angle_rad), 0.0], (np.asarray(times).size, 1)
        )

    return path
