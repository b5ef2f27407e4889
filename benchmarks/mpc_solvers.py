"""The gaze MPC's solver beside other ways to solve the same problem: `python -m benchmarks.mpc_solvers`.

One closed-loop run of the MPC is simulated: a person walks past, first with their way known ahead, then forecast from
noisy sightings; after that the one to look at changes every 0.8 s, 60 to 90 degrees away and once beyond the limits, so
that limits of position, velocity, acceleration and jerk bind. Every solver gets the states and references of this run's
control ticks, one after the other; its commands are compared with an accurate solution. Times are process CPU time of
whole calls as seen from Python, for both joints, on one thread. They depend on the machine: read the ratios.
"""

from __future__ import annotations

import os

# One thread for linear algebra: CPU time counts the waiting of others. Must be set before numpy is imported.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import contextlib
import gc
import platform
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from tqdm import tqdm

from benchmarks.solver_peers import PEERS, Accurate, Gazempc, Peer, PeerFailedError
from benchmarks.step_time import bare_kalman_step, cpu_ms
from experiments.command import run_command
from gazempc.controllers import Mpc, Situation
from gazempc.controllers.controller import CommandState
from gazempc.controllers.ocp import Solution, servo_step
from gazempc.errors import SettingsError, suggest
from gazempc.kinematics import look_at, unwrap_pan
from gazempc.neck import CommandLimits, NeckSpec, load_neck
from predictors import ConstantVelocity, Forecast, HeadObservation

FloatArray = NDArray[np.float64]

STEPS = 40
SMOOTHING_TIME_S = 0.075
# A command this near to the accurate one is the same.
AGREE_RAD = 1e-4
# Calls that are not timed: solvers set themselves up in their first ones.
WARM_UP = 5
_NOISE_M = 0.01
_HOLD_TICKS = 40
# Where the targets are, pan and tilt; the person before them leaves at pan 63 deg, and the fifth is beyond the limits.
_TARGETS_DEG = ((-20, -15), (50, 30), (-35, -30), (40, 10), (100, 60), (20, -20))
_TARGET_DISTANCE_M = 1.5
# Longer horizons than this are measured with a run of fewer ticks, as a call may take a third of a second.
_LONG_STEPS = 100
_LONG_TICKS = 100
# How fast somebody who stands may move.
_STANDING_M_S = 0.1
# A limit is reached where this share of it is used.
_REACHED = 1.0 - 1e-5


class MpcSolversSettings(BaseModel):
    """Settings of `python -m benchmarks.mpc_solvers`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    ticks: int = Field(
        default=500, ge=20, description="Control ticks of the run; six tenths of them of the person walking"
    )
    peers: tuple[str, ...] = Field(
        default=tuple(peer.name for peer in PEERS), min_length=1, description="Solvers to measure"
    )
    growth: tuple[Annotated[int, Field(ge=2)], ...] = Field(
        default=(20, 40, 80, 160), description="Lengths of the horizon to measure ours with, control periods"
    )
    json_file: Annotated[Path | None, tyro.conf.arg(name="json", metavar="FILE")] = Field(
        default=None, description="Where to save the figures"
    )
    compare: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = Field(
        default=None, description="Figures saved earlier, to show what has changed"
    )


class PeerFigures(BaseModel):
    """Figures of one solver; times in CPU milliseconds of a call for both joints."""

    name: str
    median_ms: float = Field(gt=0)
    p95_ms: float
    p99_ms: float
    max_ms: float
    agrees: bool
    worst_difference_rad: float | None
    ticks_over: int
    failures: int
    calls: int
    step_median_ms: float | None = None
    step_p99_ms: float | None = None


class GrowthFigures(BaseModel):
    """Ours with one length of the horizon; the binding median is None if no limit binds."""

    horizon_steps: int
    median_ms: float
    median_binding_ms: float | None
    calls: int
    failures: int


class Figures(BaseModel):
    """All that is saved."""

    peers: list[PeerFigures]
    growth: list[GrowthFigures]
    ticks: int
    ticks_with_limits: int
    ticks_by_limit: dict[str, int]
    ticks_softened: int
    solvers: dict[str, int]
    bare_kalman_ms: float = Field(gt=0)
    versions: dict[str, str]
    machine: dict[str, str | int]


@dataclass(frozen=True)
class Run:
    """The problems of a closed-loop run of K control ticks.

    Attributes:
        states: Initial states of pan and tilt, shape (K, 2, 5).
        references: Reference angles, shape (K, 2, N).
        situations: What the controller was told at each tick.
        binding: Whether a limit binds, shape (K,): the best motion without limits would leave one.
        by_limit: In how many ticks each limit is reached somewhere on the horizon.
        softened: In how many ticks ours left a limit; others, with hard limits, would have no solution.
        solvers: How many of the 2 K programs each solver answered.
    """

    states: FloatArray
    references: FloatArray
    situations: list[Situation]
    binding: NDArray[np.bool_]
    by_limit: dict[str, int]
    softened: int
    solvers: dict[str, int]


def heads_m(times_s: FloatArray) -> FloatArray:
    """Head of the person who walks past, shape (H, 3); at time 0 it is at a pan angle of 63 deg."""
    # The head goes up and down twice, and sideways once, a stride.
    stride = 2.0 * np.pi * 0.9 * times_s
    return np.stack([1.5 + 0.02 * np.sin(stride), 3.0 + 1.2 * times_s, 0.35 + 0.02 * np.sin(2.0 * stride)], axis=1)


def target_m(pan_deg: float, tilt_deg: float) -> FloatArray:
    """A head in a direction, shape (3,)."""
    pan, tilt = np.deg2rad((pan_deg, tilt_deg))
    return _TARGET_DISTANCE_M * np.array([np.cos(pan) * np.cos(tilt), np.sin(pan) * np.cos(tilt), np.sin(tilt)])


def forecasts(neck: NeckSpec, steps: int, ticks: int, seed: int) -> Iterator[Forecast]:
    """What is forecast at each control tick.

    Args:
        neck: The neck.
        steps: Length of the horizon, control periods.
        ticks: Control ticks.
        seed: For the noise of what is seen.

    Yields:
        In the first three tenths the way that a person really walks past, in the next three tenths a constant-velocity
        forecast of them from noisy sightings, then people who stand in one place after the other.
    """
    rng = np.random.default_rng(seed)
    period_s, known, walking = neck.control_period_s, 3 * ticks // 10, 6 * ticks // 10
    ahead_s = Mpc(neck, steps * period_s).forecast_times_s(0.0, 0.0)
    predictor = ConstantVelocity(position_noise_m=_NOISE_M)
    since = -walking * period_s
    variances_m2 = _NOISE_M**2 + (_STANDING_M_S * ahead_s) ** 2
    for k in range(ticks):
        now_s, noise_m = k * period_s, rng.normal(scale=_NOISE_M, size=3)
        if k < walking:
            head_m = heads_m(np.array([since + now_s]))[0]
            predictor.update(HeadObservation(now_s, head_m + noise_m))
        if known <= k < walking:
            yield predictor.forecast(now_s + ahead_s)
            continue
        if k < known:
            means_m = heads_m(since + now_s + ahead_s)
        else:
            target = _TARGETS_DEG[(k - walking) // _HOLD_TICKS % len(_TARGETS_DEG)]
            means_m = np.tile(target_m(*target) + noise_m, (len(ahead_s), 1))
        yield Forecast(now_s + ahead_s, means_m, variances_m2[:, None, None] * np.eye(3), now_s)


def simulate(neck: NeckSpec, steps: int, ticks: int, seed: int = 0) -> Run:
    """Run our solver in closed loop, always with `STEPS` steps: joint and command move as the model says.

    Args:
        neck: The neck, with one dead time, a whole number of control periods.
        steps: For how many steps references are given.
        ticks: Control ticks.
        seed: For the noise of what is seen.

    Returns:
        What it had to solve.
    """
    limits, ocps = neck.command_limits, Gazempc(neck, STEPS, SMOOTHING_TIME_S).ocps
    models = [servo_step(axis, neck.servo_period_s) for axis in neck.axes]
    late = round(float(neck.dead_time_s[0]) / neck.control_period_s)
    on_the_way = late * neck.servo_ticks_per_plan + 1
    low, high = float(limits.position_min_rad[0]), float(limits.position_max_rad[0])
    z = np.zeros((2, 5))
    states, references, situations, answers = [], [], [], list[list[Solution]]()
    joints, sent = list[FloatArray](), list[FloatArray]()
    for k, forecast in enumerate(forecasts(neck, max(steps, STEPS), ticks, seed)):
        angles = look_at(neck.geometry, forecast.means_base_m).angles_rad
        if k == 0:
            z[:, 0] = z[:, 2] = limits.clip_position(angles[0])
            joints, sent = [z[:, :2]] * late, [z[:, 2]] * on_the_way
        states.append(z)
        reference = unwrap_pan(angles, float(z[0, 2]), low, high).T
        references.append(reference[:, :steps])
        # z is one dead time ahead of the joint, whose state now is therefore that of some ticks ago.
        q, v = joints[k].T
        situations.append(
            Situation(
                start_s=k * neck.control_period_s,
                forecast=Forecast(
                    forecast.times_s[:STEPS],
                    forecast.means_base_m[:STEPS],
                    forecast.covariances_m2[:STEPS],
                    forecast.issued_at_s,
                ),
                command=CommandState(z[:, 2], z[:, 3], z[:, 4]),
                joint_position_rad=q,
                joint_velocity_rad_s=v,
                joint_offset_rad=np.zeros(2),
                sent_rad=np.array(sent[-on_the_way:]),
                committed_rad=np.zeros((0, 2)),
            )
        )
        answers.append([ocp.solve(z[i], reference[i, :STEPS]) for i, ocp in enumerate(ocps)])
        joints.append(z[:, :2])
        z = z.copy()
        jerks = [answers[k][i].scaled_jerk[0] * ocps[i].model.jerk_scale for i in range(2)]
        for _ in range(neck.servo_ticks_per_plan):
            for i, (M, m) in enumerate(models):
                z[i] = M @ z[i] + m * jerks[i]
            sent.append(z[:, 2].copy())
    used = [solution.solver for answer in answers for solution in answer]
    return Run(
        states=np.array(states),
        references=np.array(references),
        situations=situations,
        binding=np.array([any(solution.solver != "gain" for solution in answer) for answer in answers]),
        by_limit=_by_limit(limits, answers),
        softened=sum(any(solution.softened for solution in answer) for answer in answers),
        solvers={name: used.count(name) for name in sorted(set(used))},
    )


def _by_limit(limits: CommandLimits, answers: list[list[Solution]]) -> dict[str, int]:
    command = np.array([[solution.command for solution in answer] for answer in answers])
    jerk = np.array([[solution.scaled_jerk for solution in answer] for answer in answers])
    position = command[:, :, 0]
    high, low = limits.position_max_rad[:, None], limits.position_min_rad[:, None]
    shares = {
        "position": np.abs(2.0 * position - high - low) / (high - low),
        "velocity": np.abs(command[:, :, 1]) / limits.velocity_max_rad_s[:, None],
        "acceleration": np.abs(command[:, :, 2]) / limits.acceleration_max_rad_s2[:, None],
        "jerk": np.abs(jerk),
    }
    return {name: int(np.sum(np.any(share > _REACHED, axis=(1, 2)))) for name, share in shares.items()}


def solve_all(peer: Peer, run: Run) -> tuple[FloatArray, FloatArray]:
    """Let one solver solve all ticks, one after the other.

    Args:
        peer: The solver.
        run: What to solve.

    Returns:
        CPU time of each call, shape (K,), milliseconds; command of pan and tilt at the end of the first control
        period, shape (K, 2), radians, NaN where it found none.
    """
    times_ms, first = np.zeros(len(run.states)), np.full((len(run.states), 2), np.nan)
    gc.collect()
    progress = tqdm(zip(run.states, run.references, strict=True), total=len(first), desc=peer.name, leave=False)
    for k, (states, references) in enumerate(progress):
        command = np.full((2, 1), np.nan)
        started_ns = time.process_time_ns()
        with contextlib.suppress(PeerFailedError):
            command = peer.solve(states, references)
        times_ms[k] = 1e-6 * (time.process_time_ns() - started_ns)
        first[k] = command[:, 0]
    return times_ms, first


def measure(peer: Peer, run: Run, accurate_rad: FloatArray) -> PeerFigures:
    """Time one solver and compare its commands.

    Args:
        peer: The solver.
        run: What to solve.
        accurate_rad: Accurate commands at the end of the first control period, shape (K, 2).

    Returns:
        The figures.
    """
    times_ms, first = solve_all(peer, run)
    difference = np.abs(first - accurate_rad).max(axis=1)
    failed = np.isnan(difference)
    timed_ms = times_ms[WARM_UP:]
    return PeerFigures(
        name=peer.name,
        median_ms=float(np.median(timed_ms)),
        p95_ms=float(np.percentile(timed_ms, 95)),
        p99_ms=float(np.percentile(timed_ms, 99)),
        max_ms=float(timed_ms.max()),
        agrees=bool(np.all(difference <= AGREE_RAD)),
        worst_difference_rad=None if failed.all() else float(np.nanmax(difference)),
        ticks_over=int(np.sum(difference > AGREE_RAD)),
        failures=int(failed.sum()),
        calls=len(timed_ms),
    )


def grow(neck: NeckSpec, steps: int, ticks: int) -> GrowthFigures:
    """Time ours with one length of the horizon, from the same states; a run of fewer ticks for long ones."""
    run = simulate(neck, steps, ticks if steps <= _LONG_STEPS else min(ticks, _LONG_TICKS))
    times_ms, first = solve_all(Gazempc(neck, steps, SMOOTHING_TIME_S), run)
    times_ms = times_ms[WARM_UP:]
    binding_ms = times_ms[run.binding[WARM_UP:]]
    return GrowthFigures(
        horizon_steps=steps,
        median_ms=float(np.median(times_ms)),
        median_binding_ms=float(np.median(binding_ms)) if len(binding_ms) else None,
        calls=len(times_ms),
        failures=int(np.isnan(first).any(axis=1).sum()),
    )


def chosen_peers(names: Sequence[str]) -> tuple[list[type[Peer]], list[str]]:
    """Find the solvers that were asked for.

    Args:
        names: Their names; ours is always among them.

    Returns:
        Those that are installed, and for each other one what to do about it.

    Raises:
        SettingsError: If there is no such solver.
    """
    known = {peer.name: peer for peer in PEERS}
    for name in names:
        if name not in known:
            raise SettingsError(f"--peers: there is no {name!r}; {suggest(name, known)}")
    asked = [peer for peer in PEERS if peer.name in names or peer is Gazempc]
    missing = [peer for peer in asked if not peer.is_installed()]
    how = [f"{peer.name}: skipped, not installed: pip install {peer.package} (extra 'bench')" for peer in missing]
    return [peer for peer in asked if peer not in missing], how


def read_figures(path: Path) -> Figures:
    """Read figures saved earlier.

    Args:
        path: What ``--json`` wrote.

    Returns:
        The figures.

    Raises:
        SettingsError: If it cannot be read or holds anything else.
    """
    try:
        return Figures.model_validate_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"--compare: {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise SettingsError(f"--compare: {path}: not a text file. Expected: a file written by --json") from None
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "file"
        raise SettingsError(f"--compare: {path}: {place}: {first['msg']}. Expected: a file written by --json") from None


def table(figures: Figures, earlier: Figures | None) -> str:
    """Write the figures for reading.

    Args:
        figures: The figures.
        earlier: Figures to compare with, from another run.

    Returns:
        Lines.
    """
    ours = figures.peers[0].median_ms
    head = f"{'CPU time of a call [ms]':<24}{'median':>9}{'p95':>9}{'p99':>9}{'max':>9}{'ratio':>8}{'calls':>7}"
    head += f"{'worst diff. [rad]':>19}{'over':>6}{'failed':>8}{'agrees':>8}"
    lines = [head + (f"{'change':>9}{'to bare':>9}" if earlier else "")]
    before = {peer.name: peer for peer in earlier.peers} if earlier else {}
    for peer in figures.peers:
        worst = "-" if peer.worst_difference_rad is None else f"{peer.worst_difference_rad:.1e}"
        line = f"{peer.name:<24}{peer.median_ms:>9.3f}{peer.p95_ms:>9.3f}{peer.p99_ms:>9.3f}{peer.max_ms:>9.3f}"
        line += f"{peer.median_ms / ours:>8.1f}{peer.calls:>7}{worst:>19}{peer.ticks_over:>6}{peer.failures:>8}"
        line += f"{'yes' if peer.agrees else 'NO':>8}"
        if earlier and peer.name in before:
            change = peer.median_ms / before[peer.name].median_ms
            to_bare = change * earlier.bare_kalman_ms / figures.bare_kalman_ms
            line += f"{change - 1.0:>+9.0%}{to_bare - 1.0:>+9.0%}"
        lines.append(line)
    lines.append(
        f"ratio: median to that of gazempc. over: ticks more than {AGREE_RAD:g} rad from the accurate first command, "
        f"of {figures.ticks}; the first {WARM_UP} calls are not timed."
    )
    if earlier:
        lines.append(
            "change: of the median since the earlier figures; to bare: the same as ratio to a bare Kalman step "
            f"({earlier.bare_kalman_ms:.4f} -> {figures.bare_kalman_ms:.4f} ms), which takes out the machine's speed."
        )
    reached = ", ".join(f"{name} in {count}" for name, count in figures.ticks_by_limit.items())
    answered = ", ".join(f"{name} {count}" for name, count in figures.solvers.items())
    lines += [
        f"A limit binds in {figures.ticks_with_limits} of {figures.ticks} ticks ({reached}); limits left in "
        f"{figures.ticks_softened}. Joints' programs of gazempc answered by: {answered}.",
        f"Whole control step of gazempc, forecast in, plan out: median {figures.peers[0].step_median_ms:.3f} ms, "
        f"p99 {figures.peers[0].step_p99_ms:.3f} ms.",
    ]
    if figures.growth:
        lines.append(
            f"{'gazempc, CPU time [ms]':<24}{'median':>9}{'median where limits bind':>27}{'calls':>7}{'failed':>8}"
        )
    for row in figures.growth:
        binding = "-" if row.median_binding_ms is None else f"{row.median_binding_ms:.3f}"
        lines.append(
            f"{f'N = {row.horizon_steps}':<24}{row.median_ms:>9.3f}{binding:>27}{row.calls:>7}{row.failures:>8}"
        )
    return "\n".join(lines)


def benchmark(settings: MpcSolversSettings) -> int:
    """Measure, print and save.

    Args:
        settings: What to measure.

    Returns:
        Exit status, see `main`.

    Raises:
        SettingsError: On bad input, before anything runs.
    """
    earlier = None if settings.compare is None else read_figures(settings.compare)
    peers, missing = chosen_peers(settings.peers)
    for line in missing:
        print(line)
    neck = load_neck("reference")
    run = simulate(neck, STEPS, settings.ticks)
    bare_ms = float(np.median(bare_kalman_step()))
    accurate_rad = solve_all(Accurate(neck, STEPS, SMOOTHING_TIME_S), run)[1]
    if np.isnan(accurate_rad).any():
        raise RuntimeError(f"no accurate solution in {np.isnan(accurate_rad).any(axis=1).sum()} ticks")
    found = [measure(peer(neck, STEPS, SMOOTHING_TIME_S), run, accurate_rad) for peer in peers]
    mpc = Mpc(neck)
    steps_ms = [cpu_ms(lambda s=situation: mpc.plan(s)) for situation in run.situations][WARM_UP:]  # type: ignore[misc]
    found[0].step_median_ms, found[0].step_p99_ms = float(np.median(steps_ms)), float(np.percentile(steps_ms, 99))
    figures = Figures(
        peers=found,
        growth=[grow(neck, steps, settings.ticks) for steps in settings.growth],
        ticks=settings.ticks,
        ticks_with_limits=int(run.binding.sum()),
        ticks_by_limit=run.by_limit,
        ticks_softened=run.softened,
        solvers=run.solvers,
        bare_kalman_ms=bare_ms,
        versions={name: version(name) for name in ("numpy", "daqp", *sorted({peer.package for peer in peers}))},
        machine={
            "python": platform.python_version(),
            "platform": platform.platform(),
            "processors": os.cpu_count() or 1,
        },
    )
    print(table(figures, earlier))
    if settings.json_file is not None:
        settings.json_file.write_text(figures.model_dump_json(indent=2) + "\n", encoding="utf-8")
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, 2 on bad input, 130 if interrupted.
    """
    settings = tyro.cli(
        MpcSolversSettings, args=arguments, prog="python -m benchmarks.mpc_solvers", description=__doc__
    )
    return run_command("mpc_solvers", lambda: benchmark(settings))


if __name__ == "__main__":
    sys.exit(main())
