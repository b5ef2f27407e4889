"""Identities, looks away and switches: `python -m experiments.people --out out/people`.

Two synthetic walkers cross, 0.3 to 1.5 m behind each other, under each sensor. With `--tracks FOLDER` crowds are made
of recorded head tracks. Both are tracked by gazempc and by nearest neighbour, without identities from the sensor. With
`--bags FOLDER` engagement is estimated. `--parts` measures looks away from people who stand and walk (`returns`) and
switches between two people (`switches`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from experiments.engine.command import Command
from experiments.pages import markdown
from experiments.people.identities import TRACKERS, cross, crowd_of, score
from experiments.people.standing import switches, talk
from gazempc.errors import RecordingError
from gazempc.people.company import Company
from gazempc.people.engagement import Engagement
from gazempc.people.person import PersonState
from gazempc.people.schedule import LookAways
from gazempc.recordings.load import load_together
from gazempc.recordings.recording import Recording
from gazempc.recordings.synthetic.walks import synthetic_names
from gazempc.results.attention import measure_attention
from gazempc.settings import DEFAULT_PREDICTOR, GAZES, Settings
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import SceneSettings, make_scene

# Part of a folder's name: of an engaged person, and of one who is not engaged.
_ENGAGED, _NOT = "eng", "dis"


class Decided(NamedTuple):
    """Times over all faces of bags, seconds.

    Attributes:
        faces: Number of faces.
        right_s: Decided as the name of the bag states.
        wrong_s: Decided otherwise.
        undecided_s: Not decided.
    """

    faces: int
    right_s: float
    wrong_s: float
    undecided_s: float


def decided(folder: Path) -> Decided:
    """Estimate the engagement of all faces on the bags of a folder.

    Args:
        folder: Folder of bags, whose names state the truth: ``eng`` for engaged, ``dis`` for not.

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


def _decided(walk: Recording, truth: bool) -> tuple[float, float, float]:
    engagement, track = Engagement(), walk.measured or walk.truth
    found_s: dict[bool | None, float] = {True: 0.0, False: 0.0, None: 0.0}
    step_s = np.diff(walk.times_s, prepend=walk.times_s[0]).tolist()
    for k, time_s in enumerate(walk.times_s.tolist()):
        head_m, quat = track.head_position_m[k], track.head_quat_wxyz[k]
        state = PersonState(1, None, time_s, head_m, np.zeros(3), quat, time_s, 0.0)
        engaged = engagement.update(Company(time_s, (state,)))[1]
        found_s[None if engaged is None else engaged == truth] += step_s[k]
    return found_s[True], found_s[False], found_s[None]


# The neck has acquired the person by then, and all walks last longer than the look away and a second.
_START_S, _LASTS_S = 1.6, 1.4


def return_late_s(controller: str, every: int, neck: str) -> list[float]:
    """One look away from each synthetic person who walks past.

    Args:
        controller: Name of the controller.
        every: One of so many walks.
        neck: Name of the neck.

    Returns:
        Delay of the contact behind the plan, seconds, for each walk; infinite without contact.
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


# Long enough for a dozen looks away.
_TALK_S = 60.0
_SWITCH_SEEDS = 5


def crossing_table(sensors: Sequence[str], seeds: int) -> str:
    """Pairs who cross: in how many a person has the other's identity afterwards, or a new one.

    Args:
        sensors: Names of sensors.
        seeds: Number of pairs.
    """
    rows = []
    for sensor in sensors:
        for tracker in TRACKERS:
            each = [cross(seed, sensor, tracker) for seed in range(seeds)]
            swapped, renewed = (100.0 * sum(values) / len(each) for values in zip(*each, strict=True))
            rows.append([Path(sensor).stem, tracker, f"{swapped:.0f}", f"{renewed:.0f}"])
    head = ["sensor", "tracker", "identities swapped [%]", "identities renewed [%]"]
    return f"{seeds} pairs who cross\n\n" + markdown(head, rows)


def crowd_table(folder: Path, names: Sequence[str], people_per_s: Sequence[float], most: int, sensor: str) -> str:
    """Scores of the trackers in crowds.

    Args:
        folder: Folder of the tracks.
        names: Prefix of the names of the tracks of each crowd.
        people_per_s: People who enter in a second.
        most: People in a crowd, at most.
        sensor: Name of the sensor.
    """
    rows = [
        (
            *(found.crowd, f"{rate:g}", str(found.people), str(found.at_once), found.tracker),
            *(f"{found.mota:.3f}", f"{found.idf1:.3f}", str(found.switches)),
        )
        for crowd in names
        for rate in people_per_s
        for found in score(crowd, crowd_of(folder, crowd, rate, most), sensor, 0)
    ]
    head = ["crowd", "people a second", "people", "at once", "tracker", "MOTA", "IDF1", "switches"]
    return f"Crowds of recorded people, sensor {sensor}\n\n" + markdown(head, rows)


def engaged_table(folder: Path) -> str:
    """Share of the time for which engagement was decided on the bags of a folder, and share of that decided rightly."""
    found = decided(folder)
    known_s = found.right_s + found.wrong_s
    shares = [f"{100.0 * known_s / (known_s + found.undecided_s):.0f}", f"{100.0 * found.right_s / known_s:.0f}"]
    row = [str(found.faces), f"{known_s + found.undecided_s:.0f}", *shares]
    return "Engaged or not\n\n" + markdown(["faces", "seconds", "decided [%]", "of that rightly [%]"], [row])


def return_table(every: int) -> str:
    """Delay of the contact after looks away from a standing person, and after one from each walker.

    Args:
        every: One of so many synthetic walks.
    """
    head = ["controller", "neck", "median after plan [ms]"]
    stand = []
    for controller, neck in (*((name, "reference") for name in GAZES), ("mpc", "slow")):
        found = measure_attention(talk(controller, "listening", _TALK_S, neck))
        stand.append([controller, neck, f"{1e3 * found.return_late_s:.0f}", f"{1e3 * found.return_late_p95_s:.0f}"])
    walk = [_returns(name, "reference", return_late_s(name, every, "reference")) for name in GAZES]
    return (
        f"Contact back after looks away, a person who stands and is listened to for {_TALK_S:.0f} s\n\n"
        + markdown([*head, "95 % within [ms]"], stand)
        + "\nContact back after one look away, people who walk\n\n"
        + markdown([*head, "90 % within [ms]", "walks", "without contact"], walk)
    )


def switch_table() -> str:
    """Excess time to contact, and overshoot, of switches between two people who stand."""
    rows = []
    for controller in ("reactive", "lookahead", "mpc"):
        found = [(measure_attention(log), least_s) for log, least_s in switches(controller, _SWITCH_SEEDS, "reference")]
        late_ms = [1e3 * (each.time_to_contact_after_switch_s - least_s) for each, least_s in found]
        past_deg = max(each.switch_overshoot_deg for each, _ in found)
        late = (f"{np.median(late_ms):.0f}", f"{np.max(late_ms):.0f}")
        rows.append([controller, str(len(found)), *late, f"{past_deg:.2f}"])
    head = ["controller", "switches", "contact after the least time, median [ms]", "longest [ms]"]
    return "Switches between two people, neck reference\n\n" + markdown([*head, "overshoot, at most [deg]"], rows)


Part = Literal["crossing", "returns", "switches"]


class PeopleStudySettings(Settings):
    """Settings of `python -m experiments.people`."""

    sensors: tuple[str, ...] = Field(
        default=("reference", "body_tracker", "face_camera"), min_length=1, description="Shipped sensors or .toml files"
    )
    seeds: int = Field(default=100, ge=1, description="How many pairs cross")
    tracks: Path | None = Field(default=None, description="Folder of head tracks for crowds")
    crowds: tuple[str, ...] = Field(
        default=("hermes_bo-360", "hermes_boa-300"), description="What names of tracks of one crowd begin with"
    )
    people_per_s: tuple[float, ...] = Field(default=(1.0, 2.0), description="How many enter a crowd in a second")
    most: int = Field(default=60, ge=2, description="People in a crowd, at most")
    bags: Path | None = Field(default=None, description="Folder of ROS 2 bags whose names say who is engaged")
    parts: tuple[Part, ...] = Field(default=("crossing",), description="What is measured")
    every: int = Field(default=6, ge=1, description="For returns: one of so many synthetic walks")
    out: Path = Field(default=Path("out/people"), description="Folder to write to")


def _run(settings: PeopleStudySettings, _: str) -> int:
    measure = {
        "crossing": lambda: crossing_table(settings.sensors, settings.seeds),
        "returns": lambda: return_table(settings.every),
        "switches": switch_table,
    }
    tables = [measure[part]() for part in settings.parts]
    if settings.tracks is not None:
        crowds, rates, sensor = settings.crowds, settings.people_per_s, settings.sensors[0]
        tables.append(crowd_table(settings.tracks, crowds, rates, settings.most, sensor))
    if settings.bags is not None:
        tables.append(engaged_table(settings.bags))
    text = "\n".join(tables)
    settings.out.mkdir(parents=True, exist_ok=True)
    path = settings.out / "report.md"
    path.write_text(f"{text}\n", encoding="utf-8")
    print(f"{text}\n\n{path}")
    return 0


main = Command("people", PeopleStudySettings, __doc__, _run).main
