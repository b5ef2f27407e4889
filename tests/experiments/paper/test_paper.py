"""The paper's validation: every number against a closed form, an enumeration or a second computation."""

import csv
import dataclasses
import itertools
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are
from scipy.stats import norm, wilcoxon

from experiments.paper import filters, frames
from experiments.paper.analysis import analyse
from experiments.paper.command import main
from experiments.paper.filters import SLOW_TIME_S, TUNED_TIME_S, FilterRow, closest_time_s, misfit, sweep
from experiments.paper.frames import (
    HORIZONS_S,
    RULES,
    FrameJob,
    Frames,
    acceleration_psd,
    execute,
    filter_time_s,
    frames_of,
)
from experiments.paper.published import PUBLISHED, PublishedGroup, implied_frames, rank_biserial
from experiments.paper.report import report, side_by_side
from experiments.paper.significance import frame_test, person_test
from experiments.paper.turns import turn_error_m, turn_needed_rad, turns_needed
from experiments.paper.validation import Judged, exact_weight, leave_one_subject_out, total_error_mm, tune_weight
from gazempc.errors import GazempcError
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.recordings.readers.table import COLUMNS
from gazempc.recordings.recording import Labels, Recording, Track
from gazempc.recordings.synthetic.walks import generate
from gazempc.recordings.truth import TrueHead
from gazempc.sim.sensor import load_sensor, observe
from predictors import ConstantVelocity, HeadObservation, HeadPose

ROOT = Path(__file__).resolve().parents[3]
N = 15  # the paper's steps, at 30 frames a second
FRAME_S = 1 / 30


# What the paper prints


def printed_p(statistic, n, digits):
    """One-tailed p value of a signed-rank sum by the normal approximation, as printed."""
    mean, variance = n * (n + 1) / 4, n * (n + 1) * (2 * n + 1) / 24
    return f"{norm.sf((statistic - mean) / np.sqrt(variance)):.{digits - 1}e}"


def test_the_printed_statistics_imply_2808_and_2734_frames_and_at_least_1582():
    implied = {p.group: implied_frames(p) for p in PUBLISHED}
    assert (implied["R34"].fewest, implied["R34"].most) == (2808, 2808)
    assert (implied["R56"].fewest, implied["R56"].most) == (2734, 2734)
    assert (implied["R12"].fewest, implied["R12"].most) == (1582, None)
    assert implied["R34"].thinned_p_value == pytest.approx(6.8e-8, rel=0.01)
    assert implied["R56"].thinned_p_value == pytest.approx(0.22, abs=0.005)
    assert np.isnan(implied["R12"].thinned_p_value)
    assert implied["R34"].per_video == pytest.approx(2808 / 28)
    assert implied["R12"].per_video == pytest.approx(1582 / 28)
    for p in PUBLISHED[1:]:  # the numbers beside do not round to the printed p value
        fits = {n for n in range(2600, 3000) if printed_p(p.statistic, n, 3) == f"{p.p_value:.2e}"}
        assert fits == {implied[p.group].fewest}


@settings(max_examples=25)
@given(n=st.integers(30, 300), z=st.floats(-3.0, 6.0), digits=st.integers(2, 4))
def test_the_number_of_frames_is_found_again(n, z, digits):
    total = n * (n + 1) // 2
    statistic = round(n * (n + 1) / 4 + z * np.sqrt(n * (n + 1) * (2 * n + 1) / 24))
    assume(0 <= statistic <= total)
    text = printed_p(statistic, n, digits)
    found = implied_frames(PublishedGroup("G", "g", 1.0, 1.0, statistic, float(text), digits), most=2 * n)
    assert found.fewest <= n <= (found.most or 2 * n)
    assert printed_p(statistic, found.fewest, digits) == text
    assert found.fewest * (found.fewest + 1) / 2 >= statistic
    if found.most is not None:
        assert printed_p(statistic, found.most, digits) == text
        assert printed_p(statistic, found.most + 1, digits) != text


def test_a_p_value_that_no_number_of_frames_has_is_refused():
    # The statistic is more than half of all ranks for any number of frames up to 20: p > 0.5 cannot be.
    with pytest.raises(ValueError, match="no number of frames up to 20"):
        implied_frames(PublishedGroup("G", "g", 1.0, 1.0, 190.0, 0.9, 2), most=20)
    # Nine ranks sum to 45 at most, so that they cannot have the p value that the formula gives for 55.
    with pytest.raises(ValueError, match="no number of frames"):
        implied_frames(PublishedGroup("G", "g", 1.0, 1.0, 55.0, float(printed_p(55, 9, 3)), 3), most=50)


# The filter's time constant


@given(psd=st.floats(1e-8, 1e3), noise_m=st.floats(1e-4, 1.0))
def test_time_constant_and_noise_density_are_inverse(psd, noise_m):
    assert acceleration_psd(filter_time_s(psd, noise_m), noise_m) == pytest.approx(psd, rel=1e-9)
    assert filter_time_s(16 * psd, noise_m) == pytest.approx(filter_time_s(psd, noise_m) / 2)


@pytest.mark.parametrize("time_s", [0.4, 1.0, 2.0])
def test_the_steady_filter_has_this_natural_frequency_and_damping(time_s):
    """Poles of the steady-state Kalman filter by Riccati's equation."""
    F, H = np.array([[1.0, FRAME_S], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    Q = acceleration_psd(time_s) * np.array([[FRAME_S**3 / 3, FRAME_S**2 / 2], [FRAME_S**2 / 2, FRAME_S]])
    R = np.array([[0.01**2]])
    P = solve_discrete_are(F.T, H.T, Q, R)
    K = P @ H.T / (H @ P @ H.T + R)
    poles = np.log(np.linalg.eigvals((np.eye(2) - K @ H) @ F).astype(complex)) / FRAME_S
    np.testing.assert_allclose(np.abs(poles), 1 / time_s, rtol=0.06)
    np.testing.assert_allclose(-poles.real / np.abs(poles), np.sqrt(0.5), rtol=0.06)


def test_the_default_filter_is_among_those_swept():
    assert pytest.approx(filter_time_s(0.05), abs=1e-4) == TUNED_TIME_S
    assert {TUNED_TIME_S, SLOW_TIME_S} <= set(filters.FILTER_TIMES_S)


# Errors at frames


def made_errors(monkeypatch, position_m, time_s=TUNED_TIME_S, rules=("paper",), valid=None, head_deg=0.0):
    """A row made from a noise-free measured track in the sensor's own frame, body along x."""
    count = len(position_m)
    half = np.deg2rad(np.broadcast_to(head_deg, count)) / 2
    head = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1)
    waist = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    valid = np.ones(count, dtype=bool) if valid is None else valid
    seen = [np.where(valid[:, None], x, np.nan) for x in (position_m, head, position_m - [0, 0, 0.6], waist)]
    times_s = np.arange(count) / 30
    truth = Track(position_m, head, position_m - [0, 0, 0.6], waist, np.ones(count, dtype=bool))
    name = f"made{next(_COUNTER)}"
    labels = Labels("me", "straight")
    recording = Recording(name, "made", "body tracking", times_s, truth, Track(*seen, valid), True, labels)
    monkeypatch.setattr(frames, "load", lambda _: recording)
    row = execute(FrameJob(name, time_s, rules, 0))
    assert row["failed"] is None
    assert row["left_out"] is None
    return row


_COUNTER = itertools.count()
VELOCITY_M_S = np.array([0.9, -0.5, 0.0])


def line_m(count=120, start_m=(1.0, 1.0, 0.4), velocity_m_s=VELOCITY_M_S):
    return np.array(start_m) + np.arange(count)[:, None] / 30 * np.array(velocity_m_s)


def sightings_of(name, seed=0):
    recording = load(name)
    placed = place(recording, "recorded" if recording.has_robot else "side", 2.5, 1.2)
    sensor = load_sensor("recorded" if recording.measured is not None else "reference")
    sensor = sensor.model_copy(update={"range_min_m": 0.5, "range_max_m": 5.46})
    return placed, [s.observation for s in observe(placed, sensor, seed)]


def position_at(time_s, times_s, positions_m):
    """Position at a frame, or between two frames at most 0.1 s apart; None elsewhere."""
    later = [i for i, t in enumerate(times_s) if t >= time_s - 1e-6]
    if not later:
        return None
    i = later[0]
    if abs(times_s[i] - time_s) <= 1e-6:
        return positions_m[i]
    span_s = times_s[i] - times_s[i - 1]
    part = (time_s - times_s[i - 1]) / span_s
    return (1 - part) * positions_m[i - 1] + part * positions_m[i] if span_s <= 0.1 + 1e-9 else None


@pytest.mark.parametrize(
    ("name", "rule", "options"),
    [
        ("subject01_R4", "paper", {}),
        ("subject02_R1", "offset removed", {"offset_removed": True}),
        ("subject03_R6", "travel direction", {"yaw_from": "travel"}),
        ("subject04_R5", "both", {"yaw_from": "travel", "offset_removed": True}),
    ],
)
def test_the_error_at_any_weight_is_that_of_the_predictor_run_with_it(name, rule, options):
    """And for the paper's rule that of equations 1 to 5 written out, d_kalman by hand from the filter's state."""
    psd, weight = 0.01**2 / 30 / TUNED_TIME_S**4, 0.3
    placed, observations = sightings_of(name)
    kalman = ConstantVelocity(psd, 0.01, gated=False)
    head = HeadPose(weight, psd, 0.01, gated=False, **options)
    times_s, filtered, forecasts, by_hand = [], [], [], []
    F = np.eye(6) + FRAME_S * np.eye(6, k=3)
    for o in observations:
        kalman.update(o)
        head.update(o)
        _, x, _ = kalman.state()
        times_s.append(o.capture_time_s)
        filtered.append(x[:3])
        forecasts.append(head.forecast(o.capture_time_s + np.array(HORIZONS_S)).means_base_m)
        d_kalman = (F @ x - x)[:3]
        angle = head.relative_yaw_rad() or 0.0
        R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        by_hand.append(x[:3] + N * ((1 - weight) * d_kalman + weight * R @ d_kalman))
    row = execute(FrameJob(name, TUNED_TIME_S, tuple(RULES), 0))
    assert row["seen_frames"] == len(observations)
    true_head = TrueHead(placed)
    for k, horizon_s in enumerate(HORIZONS_S):
        after = [position_at(t + horizon_s, times_s, filtered) for t in times_s]
        scored = [i for i, position in enumerate(after) if position is not None]
        assert len(scored) > 20
        (own,) = frames_of([row], rule=rule, horizon_s=horizon_s)
        expected = [1e3 * np.linalg.norm(forecasts[i][k] - after[i]) for i in scored]
        np.testing.assert_allclose(own.error_mm(weight), expected, atol=1e-3)
        (true,) = frames_of([row], "true", rule, horizon_s)
        then_m = true_head(np.array([times_s[i] for i in scored]) + horizon_s)
        expected = [1e3 * np.linalg.norm(forecasts[i][k] - m) for i, m in zip(scored, then_m, strict=True)]
        np.testing.assert_allclose(true.error_mm(weight), expected, atol=1e-3)
        if horizon_s == N * FRAME_S:
            expected = [1e3 * np.linalg.norm(by_hand[i] - after[i]) for i in scored]
            np.testing.assert_allclose(own.error_mm(weight), expected, atol=1e-3)
    assert np.abs(own.turn_m).max() > 0.01


def test_on_a_straight_line_the_settled_filter_does_not_err(monkeypatch):
    row = made_errors(monkeypatch, line_m())
    for horizon_s, steps in zip(HORIZONS_S, (15, 30), strict=True):
        for against in ("filtered", "true"):
            (video,) = frames_of([row], against, horizon_s=horizon_s)
            assert video.base_m.shape == (120 - steps, 3)
            assert video.error_mm(0.0)[45:].max() < 0.01
            assert video.error_mm(0.0)[0] > 100  # at the first frame the filter knows no speed
            np.testing.assert_allclose(video.turn_m, 0.0, atol=1e-6)
    np.testing.assert_allclose(row["speed_m_s"], np.linalg.norm(VELOCITY_M_S), atol=1e-4)
    np.testing.assert_allclose(row["turn_deg"], 0.0, atol=1e-2)
    assert (row["subject"], row["group"], row["kind"]) == ("me", "straight", "body tracking")


def test_a_head_turned_for_good_turns_the_step_by_that_angle(monkeypatch):
    """Rotating s by a moves its end by 2 s sin(a / 2), to the left of travel; the body faces x, travel is aside."""
    row = made_errors(monkeypatch, line_m(), rules=tuple(RULES), head_deg=20.0)
    heading_deg = np.degrees(np.arctan2(VELOCITY_M_S[1], VELOCITY_M_S[0]))
    for horizon_s in HORIZONS_S:
        for rule, angle_deg in (("paper", 20.0), ("travel direction", 20.0 - heading_deg)):
            (video,) = frames_of([row], rule=rule, horizon_s=horizon_s)
            np.testing.assert_allclose(video.yaw_deg[45:], angle_deg, atol=0.01)
            a = np.deg2rad(angle_deg)
            R = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
            expected = horizon_s * (R @ VELOCITY_M_S - VELOCITY_M_S)
            np.testing.assert_allclose(video.turn_m[45:], np.tile(expected, (len(video.turn_m) - 45, 1)), atol=1e-5)
            error_mm = 2e3 * horizon_s * np.linalg.norm(VELOCITY_M_S) * np.sin(a / 2)
            np.testing.assert_allclose(video.error_mm(1.0)[45:], error_mm, atol=0.05)
    for rule in ("offset removed", "both"):
        (removed,) = frames_of([row], rule=rule)
        assert np.all(np.diff(np.abs(removed.yaw_deg[10:])) < 0)


def test_where_no_yaw_is_known_the_rule_adds_nothing(monkeypatch):
    row = made_errors(monkeypatch, np.tile([2.0, 0.5, 0.4], (60, 1)), rules=tuple(RULES), head_deg=30.0)
    (video,) = frames_of([row], rule="travel direction")
    assert np.isnan(video.yaw_deg).all()
    np.testing.assert_array_equal(video.turn_m, 0.0)


def test_frames_out_of_range_are_not_used(monkeypatch):
    """Along the sensor's axis from 0.2 to 7.95 m at 1.5 m/s; the distance is x itself."""
    x = 0.213 + 1.5 * np.arange(156) / 30
    row = made_errors(monkeypatch, np.stack([x, 0 * x, 0 * x], axis=1))
    inside = (x >= 0.5) & (x <= 5.46)
    assert 0 < inside.sum() < x.size
    assert row["seen_frames"] == inside.sum()
    for horizon_s, steps in zip(HORIZONS_S, (15, 30), strict=True):
        (video,) = frames_of([row], horizon_s=horizon_s)
        assert len(video.base_m) == inside.sum() - steps


def test_a_frame_whose_future_was_not_seen_is_not_scored(monkeypatch):
    """Half a second is missing: frames before it are judged only if the frame 15 later is there."""
    valid = np.ones(120, dtype=bool)
    valid[60:75] = False
    row = made_errors(monkeypatch, line_m(), valid=valid)
    scored = [i for i in range(105) if valid[i] and valid[i + 15]]
    assert row["seen_frames"] == 105
    (video,) = frames_of([row])
    kalman = ConstantVelocity(0.01**2 / 30 / TUNED_TIME_S**4, 0.01, gated=False)
    states = {}
    for i in np.flatnonzero(valid):
        kalman.update(make_observation(i))
        states[i] = kalman.state()[1]
    expected = [states[i][:3] + 0.5 * states[i][3:] - states[i + 15][:3] for i in scored]
    np.testing.assert_allclose(video.base_m, expected, atol=1e-6)


def test_an_outlier_is_taken_in_as_by_a_plain_kalman_filter(monkeypatch):
    """A jump of 2 m for one frame, which a gate would refuse, pulls both forecasts."""
    jumped_m = line_m()
    jumped_m[60] += [0.0, 2.0, 0.0]
    (video,) = frames_of([made_errors(monkeypatch, jumped_m, head_deg=20.0)])
    F, H = np.eye(6) + FRAME_S * np.eye(6, k=3), np.eye(3, 6)
    psd = 0.01**2 / 30 / TUNED_TIME_S**4
    Q = psd * np.kron([[FRAME_S**3 / 3, FRAME_S**2 / 2], [FRAME_S**2 / 2, FRAME_S]], np.eye(3))
    x, P = np.concatenate([jumped_m[0], np.zeros(3)]), np.diag([1e-4] * 3 + [1.0] * 3)
    states = [x]
    for z in jumped_m[1:]:
        x, P = F @ x, F @ P @ F.T + Q
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + 1e-4 * np.eye(3))
        x, P = x + K @ (z - H @ x), (np.eye(6) - K @ H) @ P
        states.append(x)
    turn = rotation(20.0) - np.eye(3)
    now, then = np.array(states[:-15]), np.array(states[15:])
    np.testing.assert_allclose(video.base_m, now[:, :3] + 0.5 * now[:, 3:] - then[:, :3], atol=1e-6)
    np.testing.assert_allclose(video.turn_m, 0.5 * now[:, 3:] @ turn.T, atol=1e-6)
    assert video.error_mm(0.0)[60] > 1000


def rotation(angle_deg):
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def make_observation(i):
    return HeadObservation(i / 30, line_m()[i])


@pytest.mark.parametrize("lost", [1, 2])
def test_one_or_two_lost_frames_are_bridged_wherever_they_are(monkeypatch, lost):
    """The frames around them are 0.1 s apart at most, which is not a longer gap than 0.1 s."""
    counts = set()
    for first in range(40, 60):
        valid = np.ones(90, dtype=bool)
        valid[first : first + lost] = False
        row = made_errors(monkeypatch, line_m(90), valid=valid)
        (video,) = frames_of([row])
        counts.add(len(video.base_m))
    assert counts == {90 - 15 - lost}


def test_three_lost_frames_are_not_bridged(monkeypatch):
    valid = np.ones(90, dtype=bool)
    valid[50:53] = False
    (video,) = frames_of([made_errors(monkeypatch, line_m(90), valid=valid)])
    assert len(video.base_m) == 90 - 15 - 2 * 3


def test_a_walk_around_a_circle_turns_as_it_does(monkeypatch):
    """1.2 rad/s at radius 1 m: chords of 2 sin(0.3) m, each turned by 0.6 rad to the left."""
    angle = 1.2 * np.arange(120) / 30
    circle = np.stack([3 + np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    row = made_errors(monkeypatch, circle)
    np.testing.assert_allclose(row["speed_m_s"], 2 * np.sin(0.3) / 0.5, atol=1e-3)
    np.testing.assert_allclose(row["turn_deg"], np.degrees(0.6), atol=0.1)


def test_what_cannot_be_scored_is_not_there_and_what_is_broken_says_so(tmp_path):
    broken = tmp_path / "broken.csv"
    broken.write_text("t,head_x\n0,1\n", encoding="utf-8")
    row = execute(FrameJob(str(broken), 0.1, ("paper",), 0))
    assert "missing column" in row["failed"]
    good = execute(FrameJob("subject01_R4", 0.4, ("paper",), 0))
    rows = [row, good, good | {"group": "elsewhere"}, good | {"left_out": "too near"}]
    assert [v.recording for v in frames_of(rows)] == ["subject01_R4"]


def test_a_job_is_named_by_all_it_depends_on(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("1", encoding="utf-8")
    job = FrameJob(str(path), 0.1, ("paper",), 0)
    keys = {job.key(), dataclasses.replace(job, seed=1).key(), dataclasses.replace(job, filter_time_s=0.2).key()}
    keys |= {dataclasses.replace(job, rules=("both",)).key()}
    path.write_text("2", encoding="utf-8")
    keys |= {job.key()}
    (tmp_path / "index.csv").write_text("clip,subject,group\n", encoding="utf-8")
    keys |= {job.key()}
    assert len(keys) == 6
    assert job.key() == FrameJob(str(path), 0.1, ("paper",), 0).key()


# Tuning


def video(base_m, turn_m, subject="a", group="R12", name="v"):
    base_m, turn_m = np.atleast_2d(base_m).astype(float), np.atleast_2d(turn_m).astype(float)
    return Frames(name, subject, group, base_m, turn_m, np.zeros(len(base_m)))


def random_videos(seed, count=3, size=40):
    rng = np.random.default_rng(seed)
    videos = []
    for k in range(count):
        turn = 0.1 * rng.standard_normal((size, 3))
        # Optima on either side of the bounds and between them.
        base = -rng.uniform(-0.5, 1.5) * turn + 0.05 * rng.standard_normal((size, 3))
        videos.append(video(base, turn, subject=f"s{k}", name=f"v{k}"))
    return videos


@given(seed=st.integers(0, 10_000))
def test_the_exact_weight_is_the_least_on_a_fine_grid(seed):
    videos = random_videos(seed, count=1)
    base, turn = videos[0].base_m, videos[0].turn_m
    grid = np.linspace(0, 1, 2001)
    totals = [1e3 * np.sqrt(((base + w * turn) ** 2).sum(axis=1)).sum() for w in grid]
    weight = exact_weight(videos)
    assert 0 <= weight <= 1
    assert total_error_mm(videos, weight) <= min(totals) * (1 + 1e-9)
    assert abs(weight - grid[np.argmin(totals)]) <= 1.01 / 2000


def test_the_exact_weight_at_the_bounds_is_the_bound():
    turn = [[0.1, 0, 0], [0, 0.2, 0]]
    assert exact_weight([video(turn, turn)]) == 0.0
    assert exact_weight([video(-3 * np.array(turn), turn)]) == 1.0
    # A sum of distances, not of squares: the median frame decides, 0.25 of these three.
    steps = np.array([[1.0, 0, 0]] * 3)
    assert exact_weight([video(-np.array([[0.25], [0.2], [0.9]]) * steps, steps)]) == pytest.approx(0.25, abs=1e-5)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_tuned_weight_is_as_good_as_the_exact_one(seed):
    videos = random_videos(seed)
    weight = tune_weight(videos, seed, 60)
    least = total_error_mm(videos, exact_weight(videos))
    assert least <= total_error_mm(videos, weight) <= 1.001 * least
    assert tune_weight(videos, seed, 60) == weight
    assert tune_weight(videos, seed + 10, 60) != weight


def test_another_process_tunes_the_same_weight():
    code = (
        "import sys; sys.path.insert(0, 'tests'); from test_paper import random_videos;"
        "from experiments.paper.validation import tune_weight; print(repr(tune_weight(random_videos(5), 7, 8)))"
    )
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert float(run.stdout) == tune_weight(random_videos(5), 7, 8)


def test_who_is_judged_is_not_tuned_on():
    """Only c's frames ask for w = 1, and they outweigh the others', who ask for 0; c has two videos."""
    turn = np.tile([0.1, 0.0, 0.0], (20, 1))
    videos = [
        video(-10 * turn, 10 * turn, "c", name="c1"),
        video(0 * turn, turn, "a", name="a1"),
        video(0 * turn, turn, "b", "R34", name="b1"),
        video(-10 * turn, 10 * turn, "c", "R34", name="c2"),
    ]
    judged = leave_one_subject_out(videos, 0, 30)
    assert [(j.recording, j.subject, j.group) for j in judged] == [(v.recording, v.subject, v.group) for v in videos]
    weights = {j.recording: j.weight for j in judged}
    assert weights["c1"] == weights["c2"] < 0.1
    assert min(weights["a1"], weights["b1"]) > 0.9
    for j, v in zip(judged, videos, strict=True):
        np.testing.assert_array_equal(j.baseline_mm, v.error_mm(0.0))
        np.testing.assert_allclose(j.proposed_mm, 1e3 * np.abs(v.base_m + j.weight * v.turn_m)[:, 0])
    shuffled = {j.recording: j.weight for j in leave_one_subject_out(videos, 0, 30)}
    assert shuffled == weights


def test_one_subject_cannot_be_left_out():
    with pytest.raises(GazempcError, match="at least 2 subjects"):
        leave_one_subject_out(random_videos(0, count=1), 0, 5)


# Significance


def judged_of(gains_mm_by_person, seed=0, videos=2):
    """Videos whose frames' gains (baseline - proposed) have the given means for each person."""
    rng = np.random.default_rng(seed)
    judged = []
    for k, gain in enumerate(gains_mm_by_person):
        sizes = [int(n) for n in rng.integers(5, 40, videos)]
        noise = rng.standard_normal(sum(sizes))
        gains = gain + 0.1 * (noise - noise.mean())
        proposed = rng.uniform(50, 100, sum(sizes))
        cuts = np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1])
        for i, own in enumerate(cuts):
            judged.append(Judged(f"p{k}v{i}", f"p{k}", "R34", 0.5, (proposed + gains)[own], proposed[own]))
    return judged


def swapped(judged):
    return [dataclasses.replace(j, baseline_mm=j.proposed_mm, proposed_mm=j.baseline_mm) for j in judged]


@given(seed=st.integers(0, 10_000))
def test_the_test_over_frames_is_the_rank_sum_by_hand(seed):
    rng = np.random.default_rng(seed)
    judged = []
    for k, size in enumerate(rng.integers(16, 60, 3)):
        baseline = rng.uniform(50, 150, size)
        proposed = baseline + rng.normal(-2.0, 10.0, size)
        proposed[rng.random(size) < 0.1] = np.nan
        proposed = np.where(np.isnan(proposed), baseline, proposed)  # frames without a difference
        judged.append(Judged(f"v{k}", f"p{k}", "R34", 0.5, baseline, proposed))
    baseline, proposed = (np.concatenate([getattr(j, n) for j in judged]) for n in ("baseline_mm", "proposed_mm"))
    test = frame_test(judged)

    def by_hand(differences):
        differences = differences[differences != 0]
        n = differences.size
        order = np.argsort(np.abs(differences))
        statistic = sum(rank + 1 for rank, i in enumerate(order) if differences[i] > 0)
        z = (statistic - n * (n + 1) / 4) / np.sqrt(n * (n + 1) * (2 * n + 1) / 24)
        return n, statistic, norm.sf(z)

    n, statistic, p_value = by_hand(baseline - proposed)
    assert (test.n_frames, test.n_used, test.statistic) == (baseline.size, n, statistic)
    assert test.p_value == pytest.approx(p_value, rel=1e-9)
    thinned = [np.concatenate([(j.baseline_mm - j.proposed_mm)[first::15] for j in judged]) for first in range(15)]
    assert test.p_value_thinned == pytest.approx(np.median([by_hand(few)[2] for few in thinned]), rel=1e-9)
    library = wilcoxon(baseline, proposed, zero_method="wilcox", alternative="greater", method="approx")
    assert (test.statistic, test.p_value) == (library.statistic, library.pvalue)


def test_without_any_difference_nothing_can_be_told():
    same = np.arange(30.0)
    test = frame_test([Judged("v", "p", "R12", 0.0, same, same)])
    assert (test.statistic, test.n_frames, test.n_used) == (0.0, 30, 0)
    assert np.isnan([test.p_value, test.p_value_thinned]).all()


def enumerated(gains):
    """p values better, worse and either way, over all signs that the people's gains could have had."""
    gains = np.array([g for g in gains if g])
    size = np.abs(gains)
    ranks = np.array([(size < s).sum() + ((size == s).sum() + 1) / 2 for s in size])
    sums = np.array(
        [ranks[np.array(signs, dtype=bool)].sum() for signs in itertools.product((0, 1), repeat=len(gains))]
    )
    statistic = ranks[gains > 0].sum()
    better, worse = np.mean(sums >= statistic - 1e-9), np.mean(sums <= statistic + 1e-9)
    return statistic, better, worse, min(1.0, 2 * min(better, worse))


@settings(max_examples=25)
@given(
    gains=st.lists(st.floats(-50, 50).filter(lambda g: abs(g) > 0.01), min_size=2, max_size=8), seed=st.integers(0, 99)
)
def test_the_test_over_people_is_exact(gains, seed):
    sizes = np.sort(np.abs(gains))
    assume(np.diff(sizes).min() > 1e-6)
    judged = judged_of(gains, seed)
    test = person_test(judged)
    statistic, better, worse, either = enumerated(gains)
    assert test.n_people == len(gains)
    assert test.statistic == statistic
    assert test.p_better == pytest.approx(better)
    assert test.p_worse == pytest.approx(worse)
    assert test.p_two_sided == pytest.approx(either)
    assert test.smallest_p == pytest.approx(enumerated(np.arange(1, len(gains) + 1))[1])
    assert test.difference_mm == pytest.approx(-np.mean(gains), abs=1e-9)
    total = len(gains) * (len(gains) + 1) / 2
    assert test.effect == pytest.approx((2 * statistic - total) / total)
    other = person_test(swapped(judged))
    assert other.effect == pytest.approx(-test.effect)
    assert other.difference_mm == pytest.approx(-test.difference_mm)
    assert (other.p_better, other.p_worse) == pytest.approx((test.p_worse, test.p_better))


def same_for_all_frames(gains):
    """Gains that are exactly these numbers: no rounding breaks a tie or makes a zero anything else."""
    return [
        Judged(f"v{k}", f"p{k}", "R34", 0.5, np.full(16, 128.0 + gain), np.full(16, 128.0))
        for k, gain in enumerate(gains)
    ]


@pytest.mark.parametrize("gains", [(1, 1, -1, 2, 3), (2, 2, 2, 2), (1, -1, 1, 3, 3, -3, 5)])
def test_the_test_over_people_is_exact_with_ties_too(gains):
    """Such as two copies of a recording under two names."""
    test = person_test(same_for_all_frames(gains))
    statistic, better, worse, either = enumerated(gains)
    assert test.statistic == statistic
    assert (test.p_better, test.p_worse, test.p_two_sided) == pytest.approx((better, worse, either))


def test_people_without_a_difference_are_dropped_as_frames_are():
    """With the zero method that the summary names, their ranks count for neither side."""
    gains = (0, 1, -2, 4, 8)
    test, dropped = person_test(same_for_all_frames(gains)), enumerated(gains)
    assert (test.p_better, test.p_worse, test.p_two_sided) == pytest.approx(dropped[1:])
    assert test.statistic == dropped[0]


def test_effect_of_everybody_nobody_and_a_mixture():
    assert person_test(judged_of([1, 2, 3, 4])).effect == 1.0
    assert person_test(judged_of([-1, -2, -3, -4])).effect == -1.0
    assert person_test(judged_of([1, 2, 3, -6])).effect == pytest.approx((6 - 4) / 10)
    assert person_test(judged_of([1, 2, 3, 4])).effect_ci95 is None  # of so few people the ends are the people
    assert person_test(judged_of([1, 2, 3, 4, 5])).effect_ci95 == (1.0, 1.0)


def test_every_frame_of_a_person_weighs_the_same():
    """10 frames with a gain of 1 and 30 with 5 are one person's 4, not 3."""
    a = Judged("v1", "p", "R12", 0.5, np.full(10, 1.0), np.zeros(10))
    b = Judged("v2", "p", "R12", 0.5, np.full(30, 5.0), np.zeros(30))
    c = Judged("v3", "q", "R12", 0.5, np.full(3, 2.0), np.zeros(3))
    test = person_test([a, b, c])
    assert test.n_people == 2
    assert test.difference_mm == -3.0


def test_one_person_tells_nothing_about_others():
    test = person_test(judged_of([3.0]))
    assert np.isnan([test.p_better, test.p_worse, test.p_two_sided]).all()
    assert test.difference_ci95_mm is None
    assert test.effect_ci95 is None
    assert (test.n_people, test.smallest_p) == (1, 0.5)
    assert test.difference_mm == pytest.approx(-3.0)


@settings(max_examples=15)
@given(gains=st.lists(st.floats(-50, 50), min_size=5, max_size=10))
def test_intervals_contain_the_mean_and_order_does_not_matter(gains):
    assume(np.ptp(gains) > 1e-3)
    assume(np.ptp(np.abs(gains)) > 1e-3)
    judged = judged_of(gains)
    test = person_test(judged)
    low, high = test.difference_ci95_mm
    assert low <= test.difference_mm <= high
    assert -1 <= test.effect_ci95[0] <= test.effect_ci95[1] <= 1
    turned_round = judged[::-1]
    backwards, over_frames = person_test(turned_round), frame_test(turned_round)
    assert backwards.difference_ci95_mm == pytest.approx(test.difference_ci95_mm, abs=1e-9)
    assert backwards.effect == pytest.approx(test.effect)
    assert backwards.p_better == pytest.approx(test.p_better, nan_ok=True)
    assert over_frames.p_value == pytest.approx(frame_test(judged).p_value)
    assert over_frames.p_value_thinned == pytest.approx(frame_test(judged).p_value_thinned)


def test_the_interval_over_people_has_the_width_of_a_normal_one():
    gains = np.random.default_rng(2).normal(3.0, 10.0, 40)
    low, high = person_test(judged_of(gains)).difference_ci95_mm
    assert (high - low) / 2 == pytest.approx(1.96 * gains.std() / np.sqrt(40), rel=0.05)


# Turns


@given(way_m=st.floats(0.05, 2.0), turn_rad=st.floats(-6.0, 6.0, allow_subnormal=False))
def test_error_of_going_straight_on_by_walking_the_arc(way_m, turn_rad):
    """The arc in 4000 short steps, each in the direction at its middle."""
    direction = turn_rad * (np.arange(4000) + 0.5) / 4000
    end = way_m / 4000 * np.array([np.cos(direction).sum(), np.sin(direction).sum()])
    assert turn_error_m(way_m, turn_rad) == pytest.approx(np.hypot(end[0] - way_m, end[1]), abs=1e-6)


@given(way_m=st.floats(0.05, 2.0), turn_rad=st.floats(1e-6, 4.08))
def test_the_turn_needed_is_the_inverse(way_m, turn_rad):
    needed = turn_needed_rad(way_m, turn_error_m(way_m, turn_rad))
    assert turn_error_m(way_m, needed) == pytest.approx(turn_error_m(way_m, turn_rad), abs=1e-9)
    assert needed == pytest.approx(turn_rad, rel=1e-3, abs=1e-6) or turn_rad > 4.0  # flat near the largest


@given(way_m=st.floats(0.05, 2.0), turn_rad=st.floats(1e-9, 1e-3))
def test_a_small_turn_errs_by_half_the_way_times_the_angle(way_m, turn_rad):
    assert turn_error_m(way_m, turn_rad) == pytest.approx(way_m * turn_rad / 2, rel=1e-3)


def test_no_turn_makes_any_error():
    largest = max(turn_error_m(1.0, turn) for turn in np.linspace(0, 7, 7001))
    assert turn_error_m(1.0, 0.0) == 0.0
    assert turn_needed_rad(0.6, 0.6 * largest + 1e-4) is None
    assert turn_needed_rad(0.6, 0.6 * largest - 1e-4) is not None
    assert turn_needed_rad(0.0, 0.1) is None
    # A quarter turn: the person ends at 2/pi of the way along both axes.
    assert turn_error_m(1.0, np.pi / 2) == pytest.approx(np.hypot(1 - 2 / np.pi, 2 / np.pi))


def test_turns_needed_by_hand():
    rows = [
        {"group": "straight", "speed_m_s": [1.0, 1.2, 1.4], "turn_deg": [-10.0, 2.0, 4.0]},
        {"group": "straight", "speed_m_s": [2.0, 2.0], "turn_deg": [0.0, -6.0]},
        {"group": "sharp", "speed_m_s": [0.5], "turn_deg": [50.0]},
        {"group": "elsewhere", "speed_m_s": [9.0], "turn_deg": [90.0]},
        {"group": "straight"},
    ]
    straight, sharp = turns_needed(rows)
    assert (straight["group"], straight["speed_m_s"], straight["turn_median_deg"]) == ("R12", 1.4, 4.0)
    assert straight["turn_p95_deg"] == pytest.approx(6 + 0.8 * 4)  # linear between the 4th and the 5th of five
    assert turn_error_m(0.7, np.radians(straight["turn_needed_deg"])) == pytest.approx(0.122)
    assert sharp["group"] == "R56"
    assert sharp["turn_needed_deg"] is None  # 559 mm on a way of 250 mm


# Filters


def made_row(group, subject, base_m, turn_m):
    """A row as `execute` makes it: all along x; twice the error against the true position, thrice after 1 s."""
    horizons = [
        {
            "filtered": [[k * b, 0.0, 0.0] for b in base_m],
            "true": [[2 * k * b, 0.0, 0.0] for b in base_m],
            "turn": {"paper": {"turn_m": [[t, 0.0, 0.0] for t in turn_m], "yaw_deg": [None] * len(base_m)}},
        }
        for k in (1, 3)
    ]
    labels = {"recording": f"{subject}_{group}", "source": "made", "subject": subject, "group": group}
    return {**labels, "failed": None, "left_out": None, "horizons": horizons}


def test_the_sweep_by_hand():
    rows = {
        0.1: [made_row("straight", "a", [0.1, 0.2, 0.3], [0.1, 0.0, 0.1]), made_row("turn", "b", [-0.4], [0.8])],
        1.0: [made_row("straight", "a", [0.5], [0.0])],
    }
    table = {(r.filter_time_s, r.against, r.horizon_s, r.group): r for r in sweep(rows)}
    assert len(table) == 2 * 2 * 2 + 2 * 2
    row = table[0.1, "filtered", 0.5, "R12"]
    assert row.baseline_mm == pytest.approx(200)
    assert row.error_mm == pytest.approx([(600 + 200 * w) / 3 for w in filters.WEIGHTS])
    # Together: 600 + 200 w + |800 w - 400| is least at 0.5.
    assert row.weight == pytest.approx(0.5, abs=1e-5)
    assert row.error_at_weight_mm == pytest.approx(700 / 3, abs=0.01)
    other = table[0.1, "filtered", 0.5, "R34"]
    assert other.error_mm == pytest.approx([abs(800 * w - 400) for w in filters.WEIGHTS], abs=1e-6)
    assert other.weight == row.weight
    assert table[0.1, "true", 0.5, "R12"].baseline_mm == pytest.approx(400)
    assert table[0.1, "filtered", 1.0, "R12"].baseline_mm == pytest.approx(600)
    assert table[0.1, "true", 1.0, "R34"].baseline_mm == pytest.approx(2400)
    assert table[1.0, "filtered", 0.5, "R12"].weight == 0.0


def test_the_nearest_filter_is_the_one_with_the_least_ratio():
    factors = {
        ("filtered", 0.5): {0.1: 0.5, 0.4: 1.3, 1.0: 0.8},
        ("true", 0.5): {0.1: 0.9, 0.4: 1.3, 1.0: 3.0},
        ("filtered", 1.0): {0.1: 0.2, 0.4: 0.3, 1.0: 3.5},
    }
    table = [
        FilterRow(time_s, against, horizon_s, p.group, (factor * p.baseline_mm, 1.0), 0.5, 1.0)
        for (against, horizon_s), by_time in factors.items()
        for time_s, factor in by_time.items()
        for p in PUBLISHED
    ]
    for (against, horizon_s), by_time in factors.items():
        for time_s, factor in by_time.items():
            assert misfit(table, time_s, against, horizon_s) == pytest.approx(abs(np.log(factor)))
    # log 0.8 = -0.22, log 1.3 = 0.26: too small by a fifth is nearer than too large by 0.3.
    assert closest_time_s(table, "filtered") == 1.0
    assert closest_time_s(table, "true") == 0.1
    assert closest_time_s(table, "filtered", 1.0) == 0.4
    uneven = [dataclasses.replace(r, error_mm=(2 * r.error_mm[0],)) if r.group == "R12" else r for r in table]
    expected = np.sqrt((np.log(1.6) ** 2 + 2 * np.log(0.8) ** 2) / 3)
    assert misfit(uneven, 1.0, "filtered") == pytest.approx(expected)


# The command

WALKS = {"ann_1": "subject01_R1", "ann_2": "subject01_R4", "bob_1": "subject02_R2"}
WALKS |= {"bob_2": "subject02_R6", "eve_1": "subject03_R3", "eve_2": "subject03_R5"}
PEOPLE = {"ann": "A", "bob": "B", "eve": "E"}
GROUPS = {"R1": "straight", "R2": "straight", "R3": "turn", "R4": "turn", "R5": "sharp", "R6": "sharp"}
SWEPT_S = (TUNED_TIME_S, SLOW_TIME_S, 2.0)
FIGURES = ("error_bars.png", "filters.png", "rules.png", "routes.png")


def write_walk(path, track, times_s):
    columns = (track.head_position_m, track.head_quat_wxyz, track.pelvis_position_m, track.pelvis_quat_wxyz)
    values = np.column_stack([times_s, *columns])
    np.savetxt(path, values, delimiter=",", header=",".join(COLUMNS), comments="", fmt="%.6f")


def write_walks(folder, walks=WALKS, frame_count=None, **changes):
    """Synthetic tracks as CSV files; who walks and the group stand in the index alone."""
    folder.mkdir()
    lines = ["clip,subject,group"]
    for clip, source in walks.items():
        recording = generate(source)
        part = slice(frame_count)
        parts = {f.name: getattr(recording.truth, f.name)[part] for f in dataclasses.fields(Track)}
        write_walk(folder / f"{clip}.csv", Track(**parts), recording.times_s[part])
        labels = {"subject": PEOPLE[clip[:3]], "group": GROUPS[source[-2:]]} | changes
        lines.append(f"{clip},{labels['subject']},{labels['group']}")
    (folder / "index.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def run(folder, out, jobs=1, drawn=False):
    """The command with three of its filters, figures only where wanted."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiments.paper.command.FILTER_TIMES_S", SWEPT_S)
        for name in () if drawn else ("figures.draw_bars", "figures.draw_filters", "figures.draw_rules"):
            patch.setattr(f"experiments.paper.{name}", lambda *_: None)
        if not drawn:
            patch.setattr("experiments.paper.routes_figure.draw_routes", lambda *_: None)
        return main(["--recordings", str(folder), "--jobs", str(jobs), "--trials", "5", "--out", str(out)])


def strict_json(text):
    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    return json.loads(text, parse_constant=refuse)


def stamps(out):
    return {p.name: p.stat().st_mtime_ns for p in (out / "runs").iterdir()}


@pytest.fixture(scope="module")
def validated(tmp_path_factory):
    """Six walks of three people, validated once: folder, output and exit status."""
    folder = write_walks(tmp_path_factory.mktemp("paper") / "six", frame_count=100)
    out = folder.with_name("out")
    status = run(folder, out)
    return folder, out, status


def test_the_command_writes_what_the_rows_say(validated):
    """Means, statistics and weights recomputed from the rows of jobs done here, w from the saved weights."""
    folder, out, status = validated
    assert status == 0
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert {"groups", "w_mean", "w_sd", "people", "hypotheses", "filters", "nearest", "turns", "rules"} <= set(summary)
    rows = [execute(FrameJob(str(folder / f"{clip}.csv"), TUNED_TIME_S, ("paper",), 0)) for clip in WALKS]
    assert {r["subject"] for r in rows} == set(PEOPLE.values())
    weights = summary["weights"]
    assert set(weights) == set(PEOPLE.values())
    assert summary["w_mean"] == pytest.approx(np.mean(list(weights.values())))
    assert summary["w_sd"] == pytest.approx(np.std(list(weights.values()), ddof=1))
    assert [g["group"] for g in summary["groups"]] == ["R12", "R34", "R56"]
    labels = {"R12": "straight", "R34": "turn", "R56": "sharp"}
    for g in summary["groups"]:
        own = [r for r in rows if r["group"] == labels[g["group"]]]
        base = [np.array(r["horizons"][0]["filtered"]) for r in own]
        turn = [np.array(r["horizons"][0]["turn"]["paper"]["turn_m"]) for r in own]
        baseline = [1e3 * np.linalg.norm(b, axis=1) for b in base]
        proposed = [
            1e3 * np.linalg.norm(b + weights[r["subject"]] * t, axis=1) for r, b, t in zip(own, base, turn, strict=True)
        ]
        assert (g["n_videos"], g["n_people"]) == (2, 2)
        assert g["n_frames"] == sum(b.size for b in baseline)
        assert g["baseline_mm"] == pytest.approx(np.concatenate(baseline).mean())
        assert g["proposed_mm"] == pytest.approx(np.concatenate(proposed).mean())
        library = wilcoxon(np.concatenate(baseline), np.concatenate(proposed), alternative="greater", method="approx")
        assert g["wilcoxon_statistic"] == pytest.approx(library.statistic)
        assert g["p_value"] == pytest.approx(library.pvalue)
        assert g["baseline_mm_ci95"] == pytest.approx(sorted(b.mean() for b in baseline))
        person = next(p for p in summary["people"] if p["group"] == g["group"])
        changes = [p.mean() - b.mean() for b, p in zip(baseline, proposed, strict=True)]
        assert person["difference_mm"] == pytest.approx(np.mean(changes))
        assert (person["n_people"], person["smallest_p"]) == (2, 0.25)
    pooled = next(p for p in summary["people"] if p["group"] == "R34+R56")
    assert pooled["n_people"] == 3
    turning = [v for v in frames_of(rows) if v.group != "R12"]
    means = []
    for who in weights:
        own = [v.error_mm(weights[who]) - v.error_mm(0.0) for v in turning if v.subject == who]
        means.append(np.concatenate(own).mean())
    assert pooled["difference_mm"] == pytest.approx(np.mean(means))
    assert all("cannot be told" in h["answer"] for h in summary["hypotheses"])
    best = exact_weight(frames_of(rows))
    assert summary["w_exact_all_subjects"] == pytest.approx(best, abs=1e-6)
    text = (out / "summary.md").read_text(encoding="utf-8")
    assert "7.51" in text
    assert f"{summary['groups'][0]['wilcoxon_statistic']:,.0f}" in text
    for answer in summary["hypotheses"]:
        assert answer["answer"] in text


def test_the_summary_is_json_that_any_program_reads(validated):
    strict_json((validated[1] / "summary.json").read_text(encoding="utf-8"))


def test_both_data_sets_stand_beside_what_is_published(validated):
    summary = json.loads((validated[1] / "summary.json").read_text(encoding="utf-8"))
    few = summary | {"groups": summary["groups"][:2]}
    lines = {line.split(" | ")[0].strip("| "): line for line in side_by_side({"all": summary, "few": few}).split("\n")}
    assert [c.strip() for c in lines["R34 frames"].split("|")[1:-1]][1:] == [
        "2808 (implied)",
        *[str(summary["groups"][1]["n_frames"])] * 2,
    ]
    assert "at least 1582 (implied)" in lines["R12 frames"]
    assert lines["R56 baseline [mm]"].rstrip("| ").endswith("-")
    assert "1,990,900" in lines["R56 Wilcoxon statistic"]
    assert f"| {summary['w_mean']:.2f} |" in lines["w, mean"]


def test_a_second_run_does_nothing_anew(validated):
    folder, out, _ = validated
    before, content = stamps(out), (out / "summary.json").read_bytes()
    (out / "summary.json").unlink()
    assert run(folder, out) == 0
    assert stamps(out) == before
    assert len(before) == len(WALKS) * len(SWEPT_S)
    assert (out / "summary.json").read_bytes() == content


def test_an_interrupted_run_goes_on_with_two_workers_and_ends_the_same(validated, tmp_path):
    folder, out, _ = validated
    for path in sorted((out / "runs").iterdir())[::3]:
        (tmp_path / "runs").mkdir(exist_ok=True)
        shutil.copy2(path, tmp_path / "runs")
    kept = stamps(tmp_path)
    assert run(folder, tmp_path, jobs=2, drawn=True) == 0
    after = stamps(tmp_path)
    assert {name: after[name] for name in kept} == kept
    assert after.keys() == stamps(out).keys()
    for name in after:
        assert (tmp_path / "runs" / name).read_bytes() == (out / "runs" / name).read_bytes()
    for name in ("summary.json", "summary.md"):
        assert (tmp_path / name).read_bytes() == (out / name).read_bytes()
    for name in FIGURES:
        assert (tmp_path / name).stat().st_size > 5000


def test_a_broken_recording_is_named_and_the_rest_validated(validated, tmp_path):
    folder, out, _ = validated
    shutil.copytree(out / "runs", tmp_path / "runs")
    broken = folder / "zed_1.csv"
    broken.write_text("t,head_x\n0,1\n", encoding="utf-8")
    try:
        assert run(folder, tmp_path) == 1
    finally:
        broken.unlink()
    summary, whole = (json.loads((o / "summary.json").read_text(encoding="utf-8")) for o in (tmp_path, out))
    assert list(summary["failed"]) == [str(broken)]
    assert "missing column" in summary["failed"][str(broken)]
    assert summary["n_recordings"] == 7
    assert summary["groups"] == whole["groups"]
    assert "1 failed" in (tmp_path / "summary.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"subject": "only"}, "at least 2 subjects"), ({"group": "elsewhere"}, "groups straight, turn or sharp")],
)
def test_what_cannot_be_validated_is_said(changes, message, monkeypatch, tmp_path, capsys):
    # The frames themselves do not matter here, and other processes would not know of it.
    monkeypatch.setattr("experiments.paper.command.run_jobs", lambda jobs, *_: [execute(job) for job in jobs])
    folder = write_walks(tmp_path / "few", {"ann_1": "subject01_R1", "bob_1": "subject02_R4"}, 60, **changes)
    assert run(folder, tmp_path / "out") == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error


def test_a_folder_that_is_not_there_is_refused(tmp_path, capsys):
    assert run(tmp_path / "nowhere", tmp_path / "out") == 2
    assert "nowhere" in capsys.readouterr().err


# Unusual but sound recordings


def rows_by_time(paths):
    return {t: [execute(FrameJob(str(p), t, tuple(RULES), 0)) for p in paths] for t in (TUNED_TIME_S, SLOW_TIME_S)}


def test_somebody_who_stands_does_not_spoil_the_summary(monkeypatch):
    """A standing person is `straight` and has no direction of travel, so never a yaw against it."""
    still_m = np.tile([2.0, 0.5, 0.4], (75, 1))
    walks = {"a": line_m(75), "b": line_m(75, velocity_m_s=(0.5, 0.5, 0.0)), "c": still_m}
    rows = {
        t: [
            made_errors(monkeypatch, path_m, t, tuple(RULES), head_deg=10.0 + k) | {"subject": who}
            for k, (who, path_m) in enumerate(walks.items())
        ]
        for t in (TUNED_TIME_S, SLOW_TIME_S)
    }
    summary = analyse(rows, TUNED_TIME_S, 0, 3)
    # What is published has a test of its own.
    strict_json(json.dumps({k: v for k, v in summary.items() if k != "published"}))


def test_walks_of_less_than_a_second_are_validated(tmp_path):
    """More than half a second in range is all that is asked for, so nothing may be had at the horizon of 1 s."""
    folder = write_walks(tmp_path / "short", {"ann_1": "subject01_R1", "bob_2": "subject02_R4"}, 28)
    rows = rows_by_time(sorted(p for p in folder.iterdir() if p.name != "index.csv"))
    summary = analyse(rows, TUNED_TIME_S, 0, 3)
    assert [g["n_frames"] for g in summary["groups"]] == [13, 13]


def test_a_group_of_short_walks_alone_is_reported_like_the_others(tmp_path):
    """Straight walks of less than a second beside longer turns: one group has nothing at the horizon of 1 s."""
    folder = write_walks(tmp_path / "short", {"ann_1": "subject01_R1", "bob_1": "subject02_R2"}, 28)
    longer = write_walks(tmp_path / "long", {"ann_2": "subject01_R4", "bob_2": "subject02_R3"}, 75)
    rows = rows_by_time(sorted(p for f in (folder, longer) for p in f.iterdir() if p.name != "index.csv"))
    summary = analyse(rows, TUNED_TIME_S, 0, 3)
    about = {"data": "both", "kinds": ["motion capture"], "n_recordings": 4}
    about |= {"left_out": {}, "failed": {}, "without_group": []}
    about |= {"settings": {"filter_time_s": TUNED_TIME_S, "trials": 3}}
    text = report(about | summary)
    assert "| R12 | 2 | 2 | 26 |" in text


# Real people


def test_on_real_straight_walks_the_papers_rule_costs_and_the_other_one_helps(walks_dir):
    with (walks_dir / "index.csv").open(newline="", encoding="utf-8") as file:
        clips = [r["clip"] for r in csv.DictReader(file) if r["group"] == "straight"]
    jobs = [FrameJob(str(walks_dir / f"{clip}.csv"), TUNED_TIME_S, ("paper", "both"), 0) for clip in clips]
    rows = [execute(job) for job in jobs]
    change_mm = {}
    for rule in ("paper", "both"):
        videos = frames_of(rows, rule=rule)
        change_mm[rule] = {
            subject: np.concatenate([v.error_mm(0.5) - v.error_mm(0.0) for v in videos if v.subject == subject]).mean()
            for subject in {v.subject for v in videos}
        }
    paper, both = (np.array(list(change_mm[rule].values())) for rule in ("paper", "both"))
    assert paper.size == 13
    assert (paper > 0).sum() >= 10
    assert both.mean() < paper.mean() - 5


def test_groups_count_alike_in_a_balanced_tuning():
    """Nine videos want w = 0 and one of another group w = 1: pooled frames follow the many, groups alike do not."""
    along = np.tile([0.1, 0.0, 0.0], (20, 1))
    many = [Frames(f"a{k}", f"p{k}", "R12", along, along, np.zeros(20)) for k in range(9)]
    one = Frames("b", "q", "R56", -3.0 * along, 3.0 * along, np.zeros(20))
    assert exact_weight([*many, one]) == 0.0
    assert exact_weight([*many, one], balanced=True) == 1.0
    assert tune_weight([*many, one], 0, 30, balanced=True) > 0.9


def test_the_published_test_of_straight_routes_asked_the_other_way_round():
    """Half of the possible rank sums lie above the printed one: the baseline errs less."""
    straight = implied_frames(PUBLISHED[0])
    assert straight.worse_p_value == pytest.approx(0.0048, abs=1e-4)
    assert straight.effect[1] < straight.effect[0] < 0
    for n in (10, 57):
        total = n * (n + 1) / 2
        assert rank_biserial(total, n) == pytest.approx(1.0)
        assert rank_biserial(0.0, n) == -1.0
        assert rank_biserial(total / 2, n) == pytest.approx(0.0)


def test_the_control_turns_by_the_waist():
    """With the waist itself as the cue, where the head looks does not matter; with the paper's rule it does."""
    job = FrameJob("subject02_R5", TUNED_TIME_S, ("paper", "waist itself"), 0)
    (waist,) = frames_of([execute(job)], rule="waist itself")
    (paper,) = frames_of([execute(job)])
    predictor = HeadPose(1.0, acceleration_psd(TUNED_TIME_S), 0.01, yaw_from="travel", gated=False)
    recording = load("subject02_R5")
    sensor = load_sensor("recorded")
    yaws = []
    for sighting in observe(recording, sensor, 0):
        seen = sighting.observation
        predictor.update(dataclasses.replace(seen, head_quat_wxyz=seen.pelvis_quat_wxyz))
        yaw = predictor.relative_yaw_rad()
        yaws.append(np.nan if yaw is None else np.degrees(yaw))
    np.testing.assert_allclose(waist.yaw_deg, yaws[: waist.yaw_deg.size], atol=1e-3)
    assert not np.allclose(paper.turn_m, waist.turn_m, atol=1e-3)
