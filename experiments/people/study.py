"""Gaze aversion, switches of attention and engagement: `python -m experiments.people --out out/people`.

`--parts` are gaze aversion with standing and walking people (`returns`) and switches between two people (`switches`).
With `--bags FOLDER` engagement is estimated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field
from ruckig import InputParameter, Ruckig, Trajectory

import gazempc as gz
from experiments.engine.command import Command
from experiments.pages import markdown
from gazempc.errors import RecordingError
from gazempc.people.company import Company
from gazempc.people.person import PersonState
from gazempc.people.policies import Engaged
from gazempc.people.schedule import LookAways
from gazempc.recordings.load import load_together
from gazempc.recordings.synthetic.walks import synthetic_names
from gazempc.results.attention import measure_attention
from gazempc.results.contact import CONTACT_DEG
from gazempc.results.metrics import gaze_error_deg
from gazempc.settings import DEFAULT_PREDICTOR, GAZES, AttentionSettings, LookAwayMode, LookAwaySettings, Settings
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import Scene, SceneSettings, make_scene

_RATE_HZ = 30.0
# Position at the distance of a conversation.
_AT_M = (2.5, 0.0, 0.3)
# Positions of two people, 20 to 77 deg apart; time of the switch to the second one, and duration of the run.
_TWO_M = (
    ((2.5, 0.45, 0.3), (2.5, -0.45, 0.3)),
    ((2.4, 1.0, 0.3), (2.6, -1.0, 0.3)),
    ((1.5, 1.2, 0.0), (1.5, -1.2, 0.5)),
)
_WANTED_FROM_S, _SWITCHING_S = 2.0, 6.0


class SecondLater:
    """Policy that switches from the first person to the second.

    Args:
        from_s: Time of the switch, seconds.
    """

    def __init__(self, from_s: float) -> None:
        self._from_s = from_s

    def reset(self) -> None:
        """See `gazempc.people.company.AttentionPolicy.reset`."""

    def scores(self, company: Company) -> list[float]:
        """See `gazempc.people.company.AttentionPolicy.scores`."""
        wanted = 1 + (company.time_s >= self._from_s)
        return [float(person.number == wanted) for person in company.people]


def talk(controller: str, rhythm: LookAwayMode, seconds: float, neck: str) -> gz.Log:
    """Simulate a conversation with a standing person, with gaze aversion.

    Args:
        controller: Name of the controller.
        rhythm: Schedule of the gaze aversion.
        seconds: Duration.
        neck: Name of the neck.

    Returns:
        The log.
    """
    settings = ReplaySettings(look_away=LookAwaySettings(rhythm=rhythm))
    return replay_scene(_scene(neck, seconds, _AT_M), controller, DEFAULT_PREDICTOR, settings).log


def switches(controller: str, seeds: int, neck: str) -> list[tuple[gz.Log, float]]:
    """Simulate gaze switches between two standing people.

    Args:
        controller: Name of the controller.
        seeds: Number of seeds of the sensor's errors for each pair of positions.
        neck: Name of the neck.

    Returns:
        Log of each run, and the minimum time from the switch to contact, seconds.
    """
    settings = ReplaySettings(
        attend=f"{__name__}:{SecondLater.__name__}",
        options={"from_s": _WANTED_FROM_S},
        attention=AttentionSettings(dwell_s=1.0),
    )
    found = []
    for places_m in _TWO_M:
        scene = _scene(neck, _SWITCHING_S, *places_m)
        for seed in range(seeds):
            log = replay_scene(replace(scene, seed=seed), controller, DEFAULT_PREDICTOR, settings).log
            switched = int(np.searchsorted(log.time_s, log.attended_time_s[-1]))
            found.append((log, least_time_s(log.neck, float(gaze_error_deg(log)[switched]))))
    return found


def least_time_s(neck: gz.NeckSpec, angle_deg: float) -> float:
    """Minimum time to contact of a pan from rest: time-optimal motion within the limits, plus dead time and lag.

    Args:
        neck: The neck.
        angle_deg: Angle to the person, degrees.

    Returns:
        Seconds.
    """
    motion_input, limits = InputParameter(1), neck.command_limits
    angle_rad = float(np.deg2rad(angle_deg))
    motion_input.current_position, motion_input.target_position = [0.0], [angle_rad]
    motion_input.max_velocity = [float(limits.velocity_max_rad_s[0])]
    motion_input.max_acceleration = [float(limits.acceleration_max_rad_s2[0])]
    motion_input.max_jerk = [float(limits.jerk_max_rad_s3[0])]
    motion = Trajectory(1)
    Ruckig(1).calculate(motion_input, motion)
    times_s = np.linspace(0.0, motion.duration, 1000)
    left_rad = np.array([angle_rad - motion.at_time(time_s)[0][0] for time_s in times_s])
    moving_s = float(times_s[left_rad <= np.deg2rad(CONTACT_DEG[0])][0])
    return moving_s + float(neck.dead_time_s[0] + neck.servo_lag_s[0])


def _scene(neck: str, seconds: float, *places_m: tuple[float, float, float]) -> Scene:
    times_s = np.arange(0.0, seconds, 1.0 / _RATE_HZ)
    sway_m = np.column_stack([0.02 * np.sin(0.8 * times_s), 0.03 * np.sin(1.3 * times_s), 0.01 * np.sin(1.1 * times_s)])
    settings = SceneSettings(neck=neck, sensor="reference", placement="recorded")
    walks = [
        gz.recording_from_arrays(f"standing{k}", times_s, np.array(at_m) + sway_m, in_base_frame=True)
        for k, at_m in enumerate(places_m)
    ]
    people = [make_scene(walk, settings) for walk in walks]
    return replace(people[0], others=tuple(each.walk for each in people[1:]))


# Parts of folder names that label engaged and disengaged people.
_ENGAGED, _NOT = "eng", "dis"


class Decided(NamedTuple):
    """Engagement decisions, summed over all faces of the bags.

    Attributes:
        faces: Number of faces.
        right_s: Time with the decision of the label, seconds.
        wrong_s: Time with the opposite decision.
        undecided_s: Time without a decision.
    """

    faces: int
    right_s: float
    wrong_s: float
    undecided_s: float


def decided(folder: Path) -> Decided:
    """Estimate the engagement of all faces on the bags of a folder.

    Args:
        folder: Folder of bags, labelled by ``eng`` (engaged) or ``dis`` in their names.

    Returns:
        Times over all faces.

    Raises:
        RecordingError: If there are no bags.
    """
    bags = sorted(path.parent for path in folder.glob("*/metadata.yaml"))
    if not bags:
        raise RecordingError(str(folder), "", "no bags", "a folder of ROS 2 bags")
    each = [
        _decided(walk, _ENGAGED in bag.name and _NOT not in bag.name) for bag in bags for walk in load_together(bag)
    ]
    return Decided(len(each), *np.sum(each, axis=0).tolist())


def _decided(walk: gz.Recording, truth: bool) -> tuple[float, float, float]:
    engagement, track = Engaged(), walk.measured or walk.truth
    found_s: dict[bool | None, float] = {True: 0.0, False: 0.0, None: 0.0}
    step_s = np.diff(walk.times_s, prepend=walk.times_s[0]).tolist()
    for k, time_s in enumerate(walk.times_s.tolist()):
        head_m, quat = track.head_position_m[k], track.head_quat_wxyz[k]
        known = quat if np.isfinite(quat).all() else None
        state = PersonState(1, None, time_s, head_m, np.zeros(3), known, time_s, 0.0)
        engaged = engagement.update(Company(time_s, (state,)))[1]
        found_s[None if engaged is None else engaged == truth] += step_s[k]
    return found_s[True], found_s[False], found_s[None]


# Start, after acquisition of the person, and duration of the aversion; all walks are at least 1 s longer.
_START_S, _LASTS_S = 1.6, 1.4


def return_late_s(controller: str, every: int, neck: str) -> list[float]:
    """Delay of the return to each synthetic walking person after one gaze aversion.

    Args:
        controller: Name of the controller.
        every: Stride in the list of walks.
        neck: Name of the neck.

    Returns:
        Delay of contact relative to the schedule, seconds, for each walk; infinite without contact.
    """
    found = []
    for seed, name in enumerate(synthetic_names()[::every]):
        scene = make_scene(name, SceneSettings(neck=neck))
        look_aways = LookAways(scene.neck, seed=seed)
        look_aways.think(0.0, _LASTS_S, _START_S)
        log = replay_scene(scene, controller, DEFAULT_PREDICTOR, ReplaySettings(), look_aways=look_aways).log
        late_s = measure_attention(log).return_late_s
        found.append(late_s if np.isfinite(late_s) else float("inf"))
    return found


def _returns(controller: str, neck: str, late_s: Sequence[float]) -> list[str]:
    ms = 1e3 * np.array(late_s)
    quantiles = np.median(ms), np.percentile(ms, 90, method="inverted_cdf")
    shown = (f"{each:.0f}" if np.isfinite(each) else "never" for each in quantiles)
    return [controller, neck, *shown, str(ms.size), str(int(np.isinf(ms).sum()))]


# Duration of about a dozen aversions.
_TALK_S = 60.0
_SWITCH_SEEDS = 5


def engaged_table(folder: Path) -> str:
    """Coverage of the engagement decisions on the bags of a folder, and their accuracy."""
    found = decided(folder)
    known_s = found.right_s + found.wrong_s
    shares = [
        f"{100.0 * known_s / (known_s + found.undecided_s):.0f}",
        f"{100.0 * found.right_s / known_s:.0f}" if known_s else "-",
    ]
    row = [str(found.faces), f"{known_s + found.undecided_s:.0f}", *shares]
    return "Engaged or not\n\n" + markdown(["faces", "seconds", "decided [%]", "of that correctly [%]"], [row])


def return_table(every: int) -> str:
    """Delay of contact after gaze aversion, for a standing person and for each walking person.

    Args:
        every: Stride in the list of synthetic walks.
    """
    head = ["controller", "neck", "median after plan [ms]"]
    stand = []
    for controller, neck in (*((name, "reference") for name in GAZES), ("mpc", "slow")):
        found = measure_attention(talk(controller, "listening", _TALK_S, neck))
        stand.append([controller, neck, f"{1e3 * found.return_late_s:.0f}", f"{1e3 * found.return_late_p95_s:.0f}"])
    walk = [_returns(name, "reference", return_late_s(name, every, "reference")) for name in GAZES]
    return (
        f"Renewed contact after gaze aversion, listening to a standing person for {_TALK_S:.0f} s\n\n"
        + markdown([*head, "95 % within [ms]"], stand)
        + "\nRenewed contact after one gaze aversion, walking people\n\n"
        + markdown([*head, "90 % within [ms]", "walks", "without contact"], walk)
    )


def switch_table() -> str:
    """Excess time to contact, and overshoot, of switches between two standing people."""
    rows = []
    for controller in ("reactive", "lookahead", "mpc"):
        found = [(measure_attention(log), least_s) for log, least_s in switches(controller, _SWITCH_SEEDS, "reference")]
        late_ms = [1e3 * (each.time_to_contact_after_switch_s - least_s) for each, least_s in found]
        past_deg = max(each.switch_overshoot_deg for each, _ in found)
        late = (f"{np.median(late_ms):.0f}", f"{np.max(late_ms):.0f}")
        rows.append([controller, str(len(found)), *late, f"{past_deg:.2f}"])
    head = ["controller", "switches", "contact after the minimum time, median [ms]", "longest [ms]"]
    return "Switches between two people, neck reference\n\n" + markdown([*head, "overshoot, at most [deg]"], rows)


class PeopleStudySettings(Settings):
    """Settings of `python -m experiments.people`."""

    bags: Path | None = Field(default=None, description="Folder of ROS 2 bags with labels of engagement in their names")
    parts: tuple[Literal["returns", "switches"], ...] = Field(
        default=("returns", "switches"), description="Parts to measure"
    )
    every: int = Field(default=6, ge=1, description="For returns: stride in the list of synthetic walks")
    out: Path = Field(default=Path("out/people"), description="Output folder")


def _run(settings: PeopleStudySettings, _: str) -> int:
    tables = [return_table(settings.every) if part == "returns" else switch_table() for part in settings.parts]
    text = "\n".join([*tables, *([] if settings.bags is None else [engaged_table(settings.bags)])])
    settings.out.mkdir(parents=True, exist_ok=True)
    path = settings.out / "report.md"
    path.write_text(f"{text}\n", encoding="utf-8")
    print(f"{text}\n\n{path}")
    return 0


main = Command("people", PeopleStudySettings, __doc__, _run).main
