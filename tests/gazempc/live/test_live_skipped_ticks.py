"""Ticks that are left out: the loop is woken late, or a command takes long to send."""

import numpy as np
import pytest
from builders.checks import assert_recovered, assert_sound
from builders.faults import Jumping
from builders.live import NECK, TS, run_live

from gazempc.controllers.mpc.mpc import Mpc
from gazempc.neck.ahead import settled_joints
from gazempc.sim.simulated import SimulatedNeck


class Remembering(Mpc):
    """Keeps what it is told of the joints and the commands that were sent."""

    def __init__(self):
        super().__init__(NECK, horizon_s=0.3)
        self.seen = []

    def plan(self, situation):
        self.seen.append(situation)
        return super().plan(situation)


@pytest.mark.parametrize(("where", "jump_s"), [("asleep", 0.052), ("at work", 0.05), ("at work", 2.0)])
def test_ticks_that_are_over_are_left_out_and_nothing_bursts(jump_s, where):
    """The loop is woken late once, or a command takes long to send: as seen by the robot, and by the controller."""
    clock = Jumping([(2.0, jump_s)] if where == "asleep" else [])
    controller = Remembering()
    joints = {}

    def on_read(now_s, state):
        joints[round(now_s, 6)] = state.position_rad
        return state

    blocked_s = [jump_s] if where == "at work" else []

    class HeldUp(SimulatedNeck):
        """A neck whose port is blocked once for some time, after a command has gone out."""

        def send_command(self, position_rad):
            sent = super().send_command(position_rad)
            if blocked_s and clock.now_s() >= 2.0 - 1e-9:
                clock.sleep_until_s(clock.now_s() + blocked_s.pop())
            return sent

    result = run_live(clock=clock, controller=controller, on_read=on_read, robot_class=HeldUp, duration_s=8.0)
    assert_sound(result)
    n = int(jump_s / TS + 1e-6)
    # A tick more may be done than there is time for, at the same instant.
    assert n - 2 <= result.report.skipped_ticks <= n
    assert result.report.lateness.max_ms == pytest.approx(1e3 * jump_s, abs=5.1)
    sent_s = np.array([now_s for now_s, _ in result.robot.received])
    assert max(np.searchsorted(sent_s, t + 10 * TS - 1e-9) - k for k, t in enumerate(sent_s)) <= 12
    # The grid of the ticks is kept.
    on_time = sent_s[sent_s > 2.0 + jump_s + 3 * TS]
    assert np.abs(on_time / TS - np.round(on_time / TS)).max() < 1e-6
    settled, none = settled_joints(NECK, 0), np.zeros((0, NECK.joints))
    astray = [0.0]
    for situation in controller.seen[10:]:
        # Commands are made for when the tick was due; the joints were read when it was done.
        due_s = situation.start_s
        now_s = min((t for t in joints if t >= due_s - 1e-6), default=None)
        assert now_s is not None
        assert situation.joint_position_rad == pytest.approx(joints[now_s], abs=1e-6)
        later_rad = joints.get(round(now_s + NECK.pan.dead_time_s, 6))
        if later_rad is None:
            continue
        # What has been sent takes the joints to where they really are one dead time later.
        state = settled(situation.joint_position_rad, situation.joint_velocity_rad_s, situation.sent_rad, none)
        astray += np.abs(state[0] - later_rad).tolist()
    # A command that goes out up to two ticks late acts that much later: 2.0e-5 rad as measured.
    assert max(astray) < (1e-6 if where == "at work" and jump_s == 2.0 else 2.3e-5)
    assert_recovered(result, 2.0 + jump_s + 2.0, within_deg=1.0)
    assert_recovered(result, 2.0 + jump_s + 2.5)
