"""The command: neck files, robots, records, replays, and refusals."""

import tomllib

import numpy as np
import pytest
from builders.identification import altered

from gazempc.files.documents import as_toml
from gazempc.identify import identify
from gazempc.identify.estimate import bandwidth_hz, estimate_axis
from gazempc.identify.identified import neck_toml
from gazempc.identify.latency import log_latency
from gazempc.neck.spec import load_neck
from gazempc.results.log_files import load_log
from gazempc.run import main as run_main
from gazempc.sim.simulated import SimulatedNeck

SERVO = ("dead_time_s", "natural_frequency_rad_s", "damping_ratio")


@pytest.mark.slow
def test_the_command_identifies_a_robot_and_its_record(tmp_path, capsys):
    out = tmp_path / "sub" / "mine.toml"
    assert identify.main(["--robot", "simulated", "--neck", "slow", "--out", str(out), "--duration-s", "8"]) == 0
    output = capsys.readouterr().out
    assert "400.0 ± 0.1" in output
    assert str(out) in output
    neck = load_neck(out)
    assert neck.name == "mine"
    assert neck.dead_time_s == pytest.approx([0.4, 0.4], abs=1e-4)
    assert neck.velocity_max_rad_s.tolist() == load_neck("slow").velocity_max_rad_s.tolist()
    assert out.with_suffix(".png").stat().st_size > 20_000
    again = tmp_path / "again.toml"
    words = ["--from-log", str(out.with_suffix(".npz")), "--out", str(again), "--axes", "pan"]
    assert identify.main(words) == 0
    assert load_neck(again).pan == neck.pan
    assert load_neck(again).tilt == load_neck("slow").tilt


@pytest.mark.slow
def test_a_replay_determines_neck_and_sensor_latency(tmp_path, capsys):
    words = ["--replay", "subject03_R4", "--controllers", "lookahead", "--predictor", "constant_velocity"]
    assert run_main([*words, "--no-figures", "--noise-seeds", "1", "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    path = tmp_path / "lookahead.npz"
    assert identify.main(["--from-log", str(path), "--out", str(tmp_path / "n.toml")]) == 0
    neck = load_neck(tmp_path / "n.toml")
    for axis in neck.axes:
        assert axis.dead_time_s == pytest.approx(0.4, abs=0.005)
        assert bandwidth_hz(axis.natural_frequency_rad_s, axis.damping_ratio) == pytest.approx(1.4251, rel=0.05)
    assert "Sensor latency" in capsys.readouterr().out
    log = load_log(path)
    arrived, captured = log_latency(log)
    late_s = float(np.mean(log.arrival_time_s - log.capture_time_s))
    assert arrived.low <= late_s <= arrived.high
    assert captured.low <= 0 <= captured.high


def test_a_neck_file_keeps_unidentified_values(clean, tmp_path):
    found, fetch = estimate_axis(clean, 0), load_neck("fetch")
    path = tmp_path / "n.toml"
    path.write_text(neck_toml(fetch, [found], 'odd "name"', "a\\b\n\x7f"), encoding="utf-8")
    neck = load_neck(path)
    assert neck.name == 'odd "name"'
    assert " from a\\b\n\x7f" in neck.source
    servo = {name: float(f"{getattr(found, name).value:.6g}") for name in SERVO}
    assert neck.pan == fetch.pan.model_copy(update=servo)
    assert (neck.tilt, neck.geometry, neck.servo_rate_hz) == (fetch.tilt, fetch.geometry, fetch.servo_rate_hz)


def test_invalid_command_lines_are_refused(clean, tmp_path, capsys):
    out = str(tmp_path / "n.toml")
    still = altered(clean, command_rad=np.column_stack([clean.command_rad[:, 0], np.zeros(len(clean.command_rad))]))
    still.save(tmp_path / "still.npz")
    blind = load_neck("reference").model_copy(update={"reports_joints": False}).model_dump(exclude_none=True)
    (tmp_path / "blind.toml").write_text(as_toml(blind))
    for words, problem in (
        ([], "give one of --robot"),
        (["--robot", "simulated", "--from-log", "x.npz"], "give one of --robot"),
        (["--source", "camera:emulator"], "give one of --robot"),
        (["--source", "udp:5005", "--robot", "visca:emulator"], "--source"),
        (["--from-log", str(tmp_path / "none.npz")], "not a readable log"),
        (["--robot", "simulated", "--neck", "nock"], "no neck file 'nock'"),
        (["--robot", "simulated", "--neck", str(tmp_path / "blind.toml")], "reports_joints"),
        (["--from-log", str(tmp_path / "still.npz")], "tilt: its command moves over 0.00 deg"),
    ):
        assert identify.main([*words, "--out", out]) == 2
        assert problem in capsys.readouterr().err
    assert identify.main(["--robot", "simulated", "--out", str(tmp_path / "n.yaml")]) == 2
    assert "must end in .toml" in capsys.readouterr().err
    assert not (tmp_path / "n.toml").exists()


# ---------------------------------------------------------------- a user's own robot


class Head(SimulatedNeck):
    """A test double of a driver."""

    def __init__(self, neck, clock_s, position_rad, dead_time_s: float = 0.1):
        changed = {"dead_time_s": dead_time_s}
        axes = {name: getattr(neck, name).model_copy(update=changed) for name in ("pan", "tilt")}
        super().__init__(neck.model_copy(update=axes), position_rad, clock_s)


class Real(Head):
    keeps_any_clock = False


class NoConnection(Head):
    def connect(self):
        raise KeyError("port")


class Silent(Head):
    def read_state(self): ...
    def send_command(self, position_rad):
        raise AssertionError("moved")


class WrongShape(Head):
    def read_state(self):
        state = super().read_state()
        return type(state)(state.time_s, np.zeros(3), np.zeros(3))


class WrongSent(Head):
    def send_command(self, position_rad):
        return super().send_command(position_rad)[:1]


@pytest.mark.slow
def test_the_dead_time_of_a_user_defined_robot_is_identified(tmp_path):
    words = ["--robot", f"{__name__}:Head", "--axes", "pan", "--duration-s", "8", "--out", str(tmp_path / "mine.toml")]
    assert identify.main([*words, "--options.dead_time_s", "0.25"]) == 0
    measured = tomllib.loads((tmp_path / "mine.toml").read_text())
    assert measured["pan"]["dead_time_s"] == pytest.approx(0.25, abs=0.002)


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("Real", ["--neck", ":Real"]),
        ("NoConnection", ["connect() raised KeyError: 'port'"]),
        ("Silent", ["there is no reading", "identification does not"]),
        ("WrongShape", ["position_rad array([0., 0., 0.]), expected an array of shape (2,)"]),
        ("WrongSent", ["a command failed", "of shape (1,)"]),
    ],
)
def test_faults_of_a_robot_are_reported(name, named, tmp_path, capsys):
    out = tmp_path / "mine.toml"
    assert identify.main(["--robot", f"{__name__}:{name}", "--duration-s", "8", "--out", str(out)]) == 2
    complained = capsys.readouterr().err
    for word in named:
        assert word in complained
    assert "Traceback" not in complained
    assert not out.exists()
