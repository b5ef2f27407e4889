"""Two Dynamixel motors behind a pseudo-terminal: no wrong angle, no jump, recovery after every fault."""

import itertools
import math
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from builders.robots import with_both
from dynamixel_emulator import STATUS, Bus, Motor, packet
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

pytest.importorskip("tty", reason="pseudo-terminals are of POSIX")

from gazempc.errors import RobotError, SettingsError
from gazempc.neck.spec import load_neck
from gazempc.robots.dynamixel import DynamixelNeck
from gazempc.robots.options import DynamixelOptions

# Pan ends 0.9 ticks beyond a whole one: rounded to the nearest, a command at the limit would leave the range.
ENDS = {"position_min_deg": -80.06, "position_max_deg": 80.06}
NECK = with_both(load_neck("reference"), dead_time_s=0.02, natural_frequency_rad_s=60.0, damping_ratio=1.0)
NECK = NECK.with_axes({"pan": NECK.pan.model_copy(update=ENDS)})
TICK_RAD = 2 * math.pi / 4096
# Reply timeout without false losses on a busy machine; shorter in tests with lost replies.
PATIENT_MS, HASTY_MS = 2000.0, 120.0
links = itertools.count()

# No approach: the first command is executed at once.
AT_ONCE_RAD_S = 1e9


class Rig:
    """A neck, its two motors (ids 1 and 2) and a manual clock."""

    def __init__(self, folder, start=(2048, 2048), mode=3, spec=NECK, **options):
        self.now_s, self.spec = 0.0, spec
        self.motors = {i: Motor(p, mode) for i, p in enumerate(start, 1)}
        self.bus = Bus(folder / f"link{next(links)}", self.motors)
        self.options = {"reply_timeout_ms": PATIENT_MS, "approach_speed_rad_s": AT_ONCE_RAD_S} | options
        self.neck = self.another()

    def another(self, **options):
        return DynamixelNeck(
            self.spec, lambda: self.now_s, DynamixelOptions(port=str(self.bus.link), **(self.options | options))
        )

    def goals(self):
        """Goals of the motors, read after the bus has processed all packets."""
        return np.array(self.values("goal"))

    def values(self, name):
        last = -1
        while last != (last := len(self.bus.received)):
            time.sleep(0.02)
        with self.bus.lock:
            return [motor.get(name) for motor in self.motors.values()]

    def refuses(self, match=""):
        """Readings and commands raise."""
        for call in (self.neck.read_state, lambda: self.neck.send_command(np.zeros(2))):
            with pytest.raises(RobotError, match=match):
                call()

    def recover(self, calls=30):
        """Call until recovery; returns the state and the number of failures."""
        for failures in range(calls):
            self.now_s += 0.11
            try:
                return self.neck.read_state(), failures
            except RobotError:
                continue
        raise AssertionError(f"no recovery in {calls} calls")

    def close(self):
        self.neck.close()
        self.bus.unplug()


@contextmanager
def rig_in(folder, connected=True, **options):
    rig = Rig(folder, **options)
    try:
        if connected:
            rig.neck.connect()
        yield rig
    finally:
        rig.close()


@pytest.fixture
def rig(tmp_path):
    with rig_in(tmp_path) as rig:
        yield rig


@given(
    command=st.tuples(st.floats(-4, 4), st.floats(-4, 4)),
    zeros=st.tuples(st.integers(-60000, 60000), st.integers(-60000, 60000)),
    directions=st.tuples(st.sampled_from((1, -1)), st.sampled_from((1, -1))),
)
def test_round_trip_within_a_tick_inside_the_limits(tmp_path_factory, command, zeros, directions):
    folder = tmp_path_factory.getbasetemp()
    with rig_in(folder, start=zeros, mode=4, zero_ticks=zeros, directions=directions) as rig:
        sent = rig.neck.send_command(np.array(command))
        rig.neck.read_state()  # its reply confirms the execution of the command
        goals = np.array([motor.get("goal") for motor in rig.motors.values()])
        for motor, goal in zip(rig.motors.values(), goals, strict=True):
            motor.set("position", int(goal))
        measured = rig.neck.read_state().position_rad
    clamped = np.clip(command, NECK.position_min_rad, NECK.position_max_rad)
    np.testing.assert_allclose(sent, clamped, atol=TICK_RAD)
    # By hand: turns from zero, in the direction of the axis.
    np.testing.assert_allclose(
        sent, [d * (g - z) / 4096 * 2 * math.pi for d, g, z in zip(directions, goals, zeros, strict=True)]
    )
    np.testing.assert_allclose(measured, sent, atol=1e-12)
    assert np.all(sent >= NECK.position_min_rad)
    assert np.all(sent <= NECK.position_max_rad)


def test_signs_and_units_equal_values_by_hand(tmp_path):
    with rig_in(tmp_path, zero_ticks=(1024, 2048), directions=(-1, 1)) as rig:
        for motor, position, velocity in zip(rig.motors.values(), (1536, 2304), (100, -50), strict=True):
            motor.set("position", position)
            motor.set("velocity", velocity)
        state = rig.neck.read_state()
    np.testing.assert_allclose(np.rad2deg(state.position_rad), [-45.0, 22.5])
    np.testing.assert_allclose(state.velocity_rad_s, [-22.9 * 2 * math.pi / 60, -11.45 * 2 * math.pi / 60])


@pytest.mark.parametrize(
    ("mode", "start", "holds_at"),
    [
        (3, (1500, 2500), (1500, 2500)),
        # Turned by hand, the position is multi-turn; with torque on in position mode it is within one turn again.
        (3, (1500 + 4096, 2500 - 8192), (1500, 2500)),
        (4, (1500 + 4096, 2500 - 8192), (1500 + 4096, 2500 - 8192)),
    ],
)
def test_enabling_torque_causes_no_jump(tmp_path, mode, start, holds_at):
    with rig_in(tmp_path, start=start, mode=mode) as rig:
        assert [motor.history for motor in rig.motors.values()] == [[("torque on", 0)]] * 2
        assert tuple(rig.goals()) == holds_at
        assert rig.values("torque") == [1, 1]
        assert rig.values("profile_velocity") == [0, 0]
        assert rig.values("profile_acceleration") == [0, 0]


def test_the_first_command_is_approached_slowly(tmp_path):
    speed_rad_s, target = 0.5, np.array([0.2, -0.1])
    with rig_in(tmp_path, start=(1900, 2150), approach_speed_rad_s=speed_rad_s) as rig:
        sent = [rig.neck.read_state().position_rad]
        while len(sent) < 1000 and np.any(np.abs(sent[-1] - target) > TICK_RAD):
            sent.append(rig.neck.send_command(target))
        steps = np.abs(np.diff(sent, axis=0))
        assert steps.max() <= speed_rad_s * NECK.servo_period_s + TICK_RAD
        way_rad = 0.2 - (1900 - 2048) * TICK_RAD
        assert len(sent) == pytest.approx(way_rad / (speed_rad_s * NECK.servo_period_s), rel=0.02)
        # After the approach, commands pass unchanged.
        np.testing.assert_allclose(rig.neck.send_command(np.array([-0.3, 0.3])), [-0.3, 0.3], atol=TICK_RAD)


def test_a_holding_neck_keeps_its_goal(rig):
    rig.neck.send_command(np.array([0.3, 0.2]))
    goals = rig.goals()
    rig.neck.close()
    for motor in rig.motors.values():
        motor.set("position", motor.get("goal") - 20)  # deflection under load
        motor.set("profile_velocity", 50)
    rig.neck = rig.another()
    rig.neck.connect()
    assert list(rig.goals()) == list(goals)
    assert rig.values("profile_velocity") == [0, 0]


def silent(motor_id, answer):
    return b""


FAULTS = {
    "silent": silent,
    "corrupt": lambda _, answer: answer[:10] + bytes([answer[10] ^ 0x10]) + answer[11:],
    "tilt lost": lambda motor_id, answer: b"" if motor_id == 2 else answer,
    # A valid packet whose data, with the CRC behind it, has the requested length.
    "too short": lambda motor_id, answer: packet(motor_id, STATUS, b"\0" * (len(answer) - 13)),
    "access error": lambda motor_id, answer: packet(motor_id, STATUS, b"\x07"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bus_fault_raises_and_the_next_call_succeeds(tmp_path, fault):
    with rig_in(tmp_path, start=(2100, 2000), reply_timeout_ms=HASTY_MS) as rig:
        rig.bus.fault = FAULTS[fault]
        with pytest.raises(RobotError):
            rig.neck.read_state()
        rig.bus.fault = None
        # At the same instant, so that the loop's tick still sends its command.
        np.testing.assert_allclose(rig.neck.send_command(np.array([0.1, 0.1])), [0.1, 0.1], atol=TICK_RAD)
        goals, position_rad = rig.goals(), rig.neck.read_state().position_rad
        rig.bus.fault = FAULTS[fault]
        rig.refuses(r"link\d+ at 1000000 baud")
        rig.bus.fault = None
        assert list(rig.goals()) == list(goals)
        rig.now_s += 0.11
        np.testing.assert_allclose(rig.neck.read_state().position_rad, position_rad)


def test_endless_noise_does_not_block_the_caller(tmp_path):
    with rig_in(tmp_path, reply_timeout_ms=50.0) as rig:
        rig.bus.fault = silent
        quiet = threading.Event()

        def make_noise():
            while not quiet.is_set():
                rig.bus._send(b"\xff\x5a" * 500)

        noise = threading.Thread(target=make_noise, daemon=True)
        noise.start()
        with pytest.raises(RobotError):
            rig.neck.read_state()
        quiet.set()
        noise.join()


def test_a_hardware_error_is_named_without_automatic_restart(rig):
    rig.motors[2].set("hardware_error", 0b100100)
    rig.motors[2].set("torque", 0)
    for _ in range(5):
        rig.refuses(r"motor 2 \(tilt\).*overheating, overload")
        rig.now_s += 0.11
    assert rig.values("torque") == [1, 0]
    assert list(rig.goals()) == [2048, 2048]
    rig.motors[2].restart(1800)  # power cycle by the user; the head has dropped
    state, failures = rig.recover()
    assert failures > 0
    np.testing.assert_allclose(state.position_rad, [0, (1800 - 2048) * TICK_RAD])
    assert rig.motors[2].history[-1] == ("torque on", 0)
    np.testing.assert_allclose(rig.neck.send_command(np.array([0.1, 0.1])), [0.1, 0.1], atol=TICK_RAD)


def test_recovery_after_a_power_loss(tmp_path):
    with rig_in(tmp_path, reply_timeout_ms=HASTY_MS) as rig:
        for motor in rig.motors.values():
            motor.answers = False
        rig.refuses("check power")
        requests = len(rig.bus.received)
        for _ in range(50):  # no retry within 0.1 s, so that ticks are not delayed
            rig.refuses("check power")
        assert len(rig.bus.received) == requests
        for motor, position in zip(rig.motors.values(), (2300, 1900), strict=True):
            motor.answers = True
            motor.restart(position)
            motor.history.clear()
        state, failures = rig.recover()
        assert failures > 0
        np.testing.assert_allclose(state.position_rad, np.array([252, -148]) * TICK_RAD)
        assert [motor.history for motor in rig.motors.values()] == [[("torque on", 0)]] * 2
        assert rig.values("profile_velocity") == [0, 0]


def test_recovery_after_a_port_loss(rig):
    rig.neck.send_command(np.array([0.2, 0.1]))
    goals = rig.goals()
    rig.bus.unplug()
    for _ in range(3):
        rig.refuses(r"link\d+ at 1000000 baud: (the port failed|cannot be opened)")
        rig.now_s += 0.11
    rig.bus.plug_in()
    state, _ = rig.recover()
    np.testing.assert_allclose(state.position_rad, np.array(rig.values("position")) * TICK_RAD - math.pi)
    assert list(rig.goals()) == list(goals)  # the motors had power all the time, and held
    np.testing.assert_allclose(rig.neck.send_command(np.array([0.1, 0.1])), [0.1, 0.1], atol=TICK_RAD)


def test_connect_reports_the_fault(tmp_path):
    with rig_in(tmp_path, connected=False, reply_timeout_ms=HASTY_MS) as rig:
        line = f"{rig.bus.link} at 1000000 baud"
        cases = [
            (rig.another(motor_ids=(1, 7)), [line, "motor 7 (tilt)", "power", "id", "baud"], lambda: None),
            (rig.another(zero_ticks=(4000, 2048)), ["(pan)", "Position Limits", "0..4095"], lambda: None),
            (rig.another(), ["motor 2 (tilt)", "model 350"], lambda: rig.motors[2].set("model", 350)),
            (rig.another(), ["motor 1 (pan)", "Operating Mode (11) is 1"], lambda: rig.motors[1].set("mode", 1)),
            (rig.another(), ["overload"], lambda: rig.motors[1].set("hardware_error", 32)),
        ]
        for neck, parts, spoil in cases:
            before = {i: bytes(motor.table) for i, motor in rig.motors.items()}
            spoil()
            with pytest.raises(RobotError) as caught:
                neck.connect()
            assert all(part in str(caught.value) for part in parts), str(caught.value)
            assert rig.values("torque") == [0, 0]
            with pytest.raises(RobotError, match="connect"):
                neck.read_state()
            for i, table in before.items():
                rig.motors[i].table[:] = table
        rig.neck.connect()  # every failed robot has released the port
        rig.neck.connect()
        with pytest.raises(RobotError, match="no other program has it"):
            rig.another().connect()
    with pytest.raises(RobotError, match=r"link\d+ at 1000000 baud: cannot be opened"):
        rig.another().connect()


def test_invalid_settings_are_refused():
    ids = [("motor_ids", wrong) for wrong in ((1, 2, 3, 4, 5), (1, 1), (1, 254))]
    for option, wrong in [*ids, ("directions", (1, 0)), ("zero_ticks", (0, 131073))]:
        with pytest.raises((SettingsError, ValidationError), match=option):
            DynamixelNeck(NECK, lambda: 0.0, DynamixelOptions(port="nowhere", **{option: wrong}))


@pytest.mark.parametrize("torque_off", [False, True])
def test_close_sets_torque_as_configured_and_releases_the_port(tmp_path, torque_off):
    with rig_in(tmp_path, torque_off_on_close=torque_off) as rig:
        open_before = len(list(Path("/dev/fd").iterdir()))
        rig.neck.send_command(np.array([0.1, 0.1]))
        rig.neck.close()
        rig.neck.close()
        assert len(list(Path("/dev/fd").iterdir())) < open_before
        assert rig.values("torque") == [0 if torque_off else 1] * 2
        with pytest.raises(RobotError, match="connect"):
            rig.neck.send_command(np.zeros(2))
        rig.neck.connect()
        assert rig.neck.read_state() is not None
