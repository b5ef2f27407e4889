"""The whole program on standard input and on a bag with recorded delays, and refusals."""

import json
import signal

import numpy as np
import pytest
from builders.bags import face_rows, write_bag
from builders.program import Program, assert_refused, check_output

from gazempc.live import session as live
from gazempc.loop.events import Event
from gazempc.results.log_files import load_log
from gazempc.results.metrics import measure


@pytest.mark.slow
def test_a_run_from_standard_input_to_its_end(tmp_path):
    """Input in real time: the neck ends at rest, all files are written, exit status 0."""
    # The predictor runs in a separate process.
    with Program("--source", "stdin", "--robot", "simulated", "--isolate", "predictor", "--out", tmp_path) as program:
        program.until_it_runs()
        program.walk(1.2)  # metrics are of logs longer than a second
        program.process.stdin.write(b"this is no observation\n")
        program.walk(0.2)
        output, errors = program.end()
        assert program.process.returncode == 0, errors
    assert "Traceback" not in errors
    summary, log = check_output(tmp_path, output)
    assert summary["stopped_by"] == "end of the source"
    # The second walk begins where the first one began, too far away for one step.
    gated = summary["refused"].pop("gate_refused")
    assert (summary["observations"], summary["used"] + gated, summary["refused"]) == (43, 42, {"bad_observation": 1})
    assert output.splitlines()[-1] == f"{42 - gated} of 43 used: {gated} gate, 1 unreadable"
    assert any("m away; " in line and "observations/s" in line for line in output.splitlines())
    assert f"bad_observation: {Event.BAD_OBSERVATION.meaning}" in output
    assert summary["warnings"] == []
    assert "bad_observation: standard input, line 37" in errors
    # Values that a live run cannot measure are null.
    assert summary["metrics_of_last_log"]["gaze_error_rms_deg"] is None
    assert summary["end_to_end_latency_ms"]["p50"] > 30.0
    assert np.ptp(log.command_position_rad[:, 0]) > 1e-3
    assert log.head_observed_base_m[:, 0] == pytest.approx(2.5)


@pytest.mark.slow
def test_a_signal_during_the_start_ends_the_program_gracefully(tmp_path):
    with Program("--source", "stdin", "--robot", "simulated", "--out", tmp_path) as program:
        program.until_it_takes_signals()
        program.process.send_signal(signal.SIGINT)
        output, errors = program.end()
        assert (program.process.returncode, errors) == (0, "")
    assert output == "gazempc.live: stopped before the robot was connected\n"
    assert not list(tmp_path.iterdir())


T = np.arange(150) / 30.0
# A person walks to and fro, 2 m in front of a camera.
WALK = np.column_stack([np.full_like(T, 2.0), 0.8 * np.sin(0.6 * T), np.full_like(T, 0.3)])


def test_a_live_run_on_a_bag_has_recorded_delays_and_joinable_logs(tmp_path, capsys):
    bag = write_bag(tmp_path / "bag", face_rows("face_a", 1e9 + T, WALK, "camera_link"), delay_s=0.08)
    out = tmp_path / "out"
    words = f"--source bag:{bag} --robot simulated --simulated-clock --out {out} --log-s 3 --log npz --no-figures"
    assert live.main([*words.split(), "--predictor", "constant_velocity", "--controller", "lookahead"]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["stopped_by"] == "end of the source"
    assert (summary["observations"], summary["used"], summary["refused"]) == (150, 150, {})
    assert summary["skipped_ticks"] == summary["late_ticks"] == summary["limit_violations"] == 0
    assert summary["logs"] == ["log_000.npz", "log_001.npz"]
    logs = [load_log(out / name) for name in summary["logs"]]
    time_s, captured_s, arrived_s, heads_m = (
        np.concatenate([getattr(log, name) for log in logs])
        for name in ("time_s", "capture_time_s", "arrival_time_s", "head_observed_base_m")
    )
    assert np.diff(time_s) == pytest.approx(0.005, abs=1e-9)
    assert captured_s - captured_s[0] == pytest.approx(T, abs=1e-5)
    # At the first tick after the arrival.
    assert np.all((arrived_s - captured_s > 0.08 - 1e-5) & (arrived_s - captured_s < 0.085 + 1e-5))
    np.testing.assert_allclose(heads_m, WALK, atol=1e-9)
    assert measure(logs[1]).gaze_error_rms_deg < 3.0  # a neck that stands still: 16 deg
    printed = capsys.readouterr().out
    assert "  face_a, 150 frames in camera_link" in printed
    assert "against the tracker's own track, smoothed without lag" in printed
    (line,) = (line for line in printed.splitlines() if line.startswith("Written to "))
    assert sorted(line.partition("/: ")[2].split(", ")) == sorted(path.name for path in out.iterdir())


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ("--source telepathy", ["--source", "telepathy", "udp:PORT", "stdin"]),
        ("--source udp:5005 --simulated-clock", ["--simulated-clock", "replay"]),
        ("--source replay --mount.on head", ["--mount.on", "base"]),
        ("--source replay --attention-out ros2:a", ["one person"]),
        ("--source replay --attend nearest --simulated-clock --attention-out ros2:a", ["real time"]),
        ("--source replay --isolate predictor --attend nearest", ["--isolate"]),
        ("--source replay --stamps.unit ms", ["--stamps", "stdin, udp, tcp, ros2"]),
        ("--source stdin --camera.fov-deg 60", ["--camera", "--source camera"]),
        ("--source udp:5005 --robot dynamixel", ["--neck"]),
        ("--source udp:5005 --mount.on eye", ["--mount.on eye"]),
        ("--source ros4hri --attend nearest --options.ros2.point-topic p", ["needs options.ros2.base_frame"]),
        ("--source ros4hri --options.ros2.point-topic p --options.ros2.base-frame b", ["look_away.rhythm told"]),
        ("--source ros4hri --options.ros2.sound-topic s --look-away.rhythm told", ["sound_topic", "with attend"]),
        ("--source bag:nowhere", ["nowhere"]),
        ("--source bag:nowhere --sensor reference", ["--sensor", "--source replay"]),
    ],
)
def test_bad_input_is_reported_with_status_2(arguments, named, tmp_path, capsys):
    assert_refused(arguments.split(), named, tmp_path, capsys)
