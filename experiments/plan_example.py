"""Draw one plan of the MPC: `python -m experiments.plan_example --replay subject03_R4 --at-s 1.6 --out plan.png`.

What was known and planned at one instant. It shows the commands on their way through the dead time, the forecast with
its confidence, the plan, the joint that will follow it, and the limits.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.figure import Figure
from pydantic import Field

from experiments.engine.command import Command
from gazempc.controllers.controller import Plan, Situation
from gazempc.controllers.mpc.condense import growing_steps
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.controllers.mpc.own import array_of
from gazempc.controllers.mpc.problem import Trajectory, limits
from gazempc.errors import SettingsError
from gazempc.neck.kinematics import angle_deviations_rad, look_at_rad
from gazempc.neck.servo import DelayedServo
from gazempc.neck.spec import NeckSpec
from gazempc.settings import DEFAULT_PREDICTOR, MpcSettings
from gazempc.sim.replay import replay_scene
from gazempc.sim.scene import SceneSettings, make_scene
from gazempc.types import FloatArray

_BEFORE_S, _AFTER_S = 0.4, 1.3


class PlanExampleSettings(SceneSettings):
    """Settings of `python -m experiments.plan_example`."""

    replay: str = Field(default="subject03_R4", description="Synthetic name or path of a recording")
    at_s: float = Field(
        default=0.3, ge=0, description="Instant of the plan that is drawn, seconds from the first frame"
    )
    neck: str = Field(default="slow", description="Shipped neck or .toml file")
    start_offset_deg: float = Field(default=20.0, description="Where the pan starts, beside the person")
    out: Path = Field(default=Path("out/plan.png"), description="Image to write")


@dataclass(frozen=True)
class Moment:
    """One plan and what it was made from."""

    situation: Situation
    plan: Plan


class _Remembering(Mpc):
    """The MPC, which keeps what it planned from what."""

    def __init__(self, neck: NeckSpec) -> None:
        super().__init__(neck, **MpcSettings().model_dump())
        self.moments: list[Moment] = []

    def reset(self) -> None:
        super().reset()
        self.moments = []

    def plan(self, situation: Situation) -> Plan:
        plan = super().plan(situation)
        # The loop goes on writing into the commands that it shows.
        self.moments.append(Moment(dataclasses.replace(situation, sent_rad=situation.sent_rad.copy()), plan))
        return plan


def plan_example(settings: PlanExampleSettings, _: str = "") -> int:
    """Replay up to the instant, and draw.

    Args:
        settings: Which instant of what.

    Returns:
        0.

    Raises:
        GazempcError: On bad input.
    """
    scene = make_scene(settings.replay, settings)
    neck, controller = scene.neck, _Remembering(scene.neck)
    log = replay_scene(scene, controller, DEFAULT_PREDICTOR).log
    moments = controller.moments
    chosen = [m for m in moments if m.situation.start_s <= settings.at_s + 1e-9]
    if not chosen:
        raise SettingsError(f"--at-s {settings.at_s}: no person had been observed yet; use a later instant")
    true_rad = look_at_rad(neck.geometry, log.head_true_base_m)[:, 0]
    figure = draw(chosen[-1], neck, log.time_s, true_rad)
    settings.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(settings.out, dpi=110)
    print(f"Plan made at {chosen[-1].situation.start_s:.2f} s of {scene.walk.name}; written to {settings.out}")
    return 0


def draw(moment: Moment, neck: NeckSpec, time_s: FloatArray, true_pan_rad: FloatArray) -> Figure:
    """Draw the pan axis of a plan.

    Args:
        moment: The plan and its situation.
        neck: The neck.
        time_s: Times of the true angles, shape (M,), seconds.
        true_pan_rad: Pan that looks at the true head, shape (M,), radians.

    Returns:
        The figure.
    """
    situation, plan = moment.situation, moment.plan
    now_s, dead_s, ts = situation.start_s, float(neck.dead_time_s[0]), neck.servo_period_s
    sent_s: FloatArray = now_s - ts * np.arange(len(situation.sent_rad), 0, -1, dtype=np.float64)
    ahead_s: FloatArray = now_s + ts * np.arange(int((plan.end_s - now_s) / ts), dtype=np.float64)
    commands = [plan.at(t) for t in ahead_s]
    joint_s, joint_rad = _joint(moment, neck, sent_s, ahead_s)

    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    forecast = situation.forecast
    two_dead_times = neck.dead_time_s[0] != neck.dead_time_s[1]
    half = slice(0, len(forecast.times_s) // (2 if two_dead_times else 1))
    pan = np.rad2deg(np.unwrap(look_at_rad(neck.geometry, forecast.means_base_m[half])[:, 0]))
    pairs = zip(forecast.means_base_m[half], forecast.covariances_m2[half], strict=True)
    sigma = np.rad2deg([angle_deviations_rad(mean, covariance)[0] for mean, covariance in pairs])
    at_s = forecast.times_s[half] - now_s
    top.fill_between(at_s, pan - sigma, pan + sigma, color="C2", alpha=0.2, label="its standard deviation")
    top.plot(at_s, pan, "C2", label="forecast of the head")
    top.plot(time_s - now_s, np.rad2deg(true_pan_rad), "k:", lw=1, label="head as it turned out")
    top.plot(sent_s - now_s, np.rad2deg(situation.sent_rad[:, 0]), "C0--", label="commands sent")
    top.plot(ahead_s - now_s, np.rad2deg([c.position_rad[0] for c in commands]), "C0", label="planned commands")
    top.plot(joint_s - now_s, np.rad2deg(joint_rad), "C1", lw=2.5, label="joint, settled until the dead time is over")
    top.axvspan(0.0, dead_s, color="0.9", zorder=0)
    shown = [np.rad2deg(joint_rad), pan]
    top.set_ylim(min(map(np.min, shown)) - 6.0, max(map(np.max, shown)) + 6.0)
    top.set_ylabel("pan [deg]")
    top.legend(fontsize=8, loc="best")
    top.set_title(f"Plan for the neck {neck.name}; grey: dead time", fontsize=10)
    times_s, shares = _shares(plan, neck)
    for name, share in zip(("position", "velocity", "acceleration"), shares, strict=True):
        bottom.plot(times_s, share, ".-", label=name)
    for sign in (-1.0, 1.0):
        bottom.axhline(sign, color="C3", ls="--", lw=1)
    bottom.set_ylabel("command, shares of its limits")
    bottom.legend(fontsize=8, loc="best")
    bottom.set_xlabel("time from now [s]")
    bottom.set_xlim(-_BEFORE_S, _AFTER_S)
    for ax in (top, bottom):
        ax.axvline(0.0, color="k", lw=0.8)
        ax.grid(alpha=0.3)
    return figure


def _joint(moment: Moment, neck: NeckSpec, sent_s: FloatArray, ahead_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    # What the joint will do: what is on its way, then the plan, through servo and dead time.
    situation, plan = moment.situation, moment.plan
    servo = DelayedServo(neck.pan, float(situation.sent_rad[0, 0]), float(sent_s[0]))
    commands = np.concatenate([situation.sent_rad[:, 0], [plan.at(t).position_rad[0] for t in ahead_s]])
    times_s, angles = np.concatenate([sent_s, ahead_s]), []
    for time_s, command_rad in zip(times_s, commands, strict=True):
        servo.advance_to(float(time_s))
        if abs(time_s - situation.start_s) < 1e-9:
            position, velocity = servo.state
            servo.correct(
                float(situation.joint_position_rad[0]) - position, float(situation.joint_velocity_rad_s[0]) - velocity
            )
        angles.append(servo.state[0])
        servo.send(float(command_rad))
    end_s = float(times_s[-1])
    later_s = np.arange(end_s, end_s + neck.pan.dead_time_s, neck.servo_period_s)[1:]
    for time_s in later_s:
        servo.advance_to(float(time_s))
        angles.append(servo.state[0])
    all_s = np.concatenate([times_s, later_s])
    from_now = all_s >= situation.start_s - 1e-9
    return all_s[from_now], np.array(angles)[from_now]


def _shares(plan: Plan, neck: NeckSpec) -> tuple[FloatArray, FloatArray]:
    # The rows of the limits in the problem's statement, at its steps that are in the plan: times, and three rows.
    lengths = growing_steps(MpcSettings().horizon_s, neck.control_period_s)
    o = Trajectory(neck, 0, lengths)
    rows = ca.Function("rows", [o.u, o.du, o.ddu], [limits(o, neck, 0)])
    times_s = array_of(o.t)[:, 0] - neck.servo_period_s
    kept = times_s <= plan.end_s - plan.start_s - plan.step_s - neck.servo_period_s
    commands = [plan.at(plan.start_s + neck.servo_period_s + time_s) for time_s in times_s]
    motion = [
        [getattr(c, name)[0] for c in commands] for name in ("position_rad", "velocity_rad_s", "acceleration_rad_s2")
    ]
    return times_s[kept], np.array(rows(*motion)).reshape(3, -1)[:, kept]


main = Command("plan_example", PlanExampleSettings, __doc__, plan_example).main

if __name__ == "__main__":
    raise SystemExit(main())
