"""The tables of the study of several people."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from experiments.people.crossing import TRACKERS, cross
from experiments.people.crowds import CrowdScore, crowd_of, score
from experiments.people.engaged import decided
from experiments.people.returns import CONTROLLERS, return_late_s, row
from experiments.people.standing import switches, talk
from gazempc.people.schedule import RHYTHMS
from gazempc.results.attention import measure_attention

# Long enough for a dozen looks away.
_TALK_S = 60.0
_SWITCH_SEEDS = 5


def crossing_table(sensors: Sequence[str], seeds: int) -> str:
    """Let pairs cross.

    Args:
        sensors: Names of sensors.
        seeds: Number of pairs.

    Returns:
        A table: of how many pairs somebody has the other's identity afterwards, or a new one.
    """
    rows = []
    for sensor in sensors:
        for tracker in TRACKERS:
            each = [cross(seed, sensor, tracker) for seed in range(seeds)]
            swapped, renewed = (100.0 * sum(values) / len(each) for values in zip(*each, strict=True))
            rows.append([Path(sensor).stem, tracker, f"{swapped:.0f}", f"{renewed:.0f}"])
    return f"{seeds} pairs who cross\n\n" + _table(
        ["sensor", "tracker", "identities swapped [%]", "identities renewed [%]"], rows
    )


def crowd_table(folder: Path, names: Sequence[str], people_per_s: Sequence[float], most: int, sensor: str) -> str:
    """Follow crowds.

    Args:
        folder: Folder of the tracks.
        names: What the names of tracks of each crowd begin with.
        people_per_s: How many enter in a second.
        most: People in a crowd, at most.
        sensor: Name of the sensor.

    Returns:
        A table of their scores.
    """
    rows: list[list[str]] = []
    for crowd in names:
        for rate in people_per_s:
            walks = crowd_of(folder, crowd, rate, most)
            rows.extend(_row(found, rate) for found in score(crowd, walks, sensor, 0))
    return f"Crowds of recorded people, sensor {sensor}\n\n" + _table(
        ["crowd", "people a second", "people", "at once", "tracker", "MOTA", "IDF1", "switches"], rows
    )


def engaged_table(folder: Path) -> str:
    """Judge who is engaged on bags.

    Args:
        folder: Folder of bags.

    Returns:
        A table: for how much of the time it was decided, and how much of that rightly.
    """
    found = decided(folder)
    known_s = found.right_s + found.wrong_s
    shares = [f"{100.0 * known_s / (known_s + found.undecided_s):.0f}", f"{100.0 * found.right_s / known_s:.0f}"]
    return "Engaged or not\n\n" + _table(
        ["faces", "seconds", "decided [%]", "of that rightly [%]"],
        [[str(found.faces), f"{known_s + found.undecided_s:.0f}", *shares]],
    )


def return_table(every: int) -> str:
    """Look away from somebody who stands, and once from each walker.

    Args:
        every: One of so many synthetic walks.

    Returns:
        Tables: how late contact is back.
    """
    head = ["controller", "neck", "median after plan [ms]"]
    stand = []
    for controller, neck in (*((name, "reference") for name in CONTROLLERS), ("mpc", "slow")):
        found = measure_attention(talk(controller, "listening", _TALK_S, neck))
        stand.append([controller, neck, f"{1e3 * found.return_late_s:.0f}", f"{1e3 * found.return_late_p95_s:.0f}"])
    walk = [row(name, "reference", return_late_s(name, every, "reference")) for name in CONTROLLERS]
    return (
        f"Contact back after looks away, somebody who stands and is listened to for {_TALK_S:.0f} s\n\n"
        + _table([*head, "95 % within [ms]"], stand)
        + "\n\nContact back after one look away, people who walk\n\n"
        + _table([*head, "90 % within [ms]", "walks", "without contact"], walk)
    )


def schedule_table(seconds: float) -> str:
    """Talk to somebody who stands, by both rhythms.

    Args:
        seconds: For how long.

    Returns:
        A table: realised durations and intervals over those of the schedule.
    """
    rows = []
    for rhythm in RHYTHMS:
        log = talk("mpc", rhythm, seconds, "reference")
        found, planned_s = measure_attention(log), log.away_end_s - log.away_start_s
        every_s = np.diff(log.away_start_s)
        lasts = [f"{np.mean(planned_s):.2f}", f"{found.away_duration_ratio:.3f}"]
        shares = [f"{100.0 * found.away_share_planned:.1f}", f"{100.0 * found.away_share:.1f}"]
        intervals = [f"{np.mean(every_s):.2f}", f"{found.away_interval_ratio:.3f}"]
        rows.append([rhythm, str(planned_s.size), *lasts, *intervals, *shares])
    head = ["rhythm", "looks away", "duration [s]", "realised / planned", "interval [s]", "realised / planned"]
    return f"Looks away over {seconds:.0f} s, mpc, neck reference\n\n" + _table(
        [*head, "away as planned [%]", "away [%]"], rows
    )


def switch_table() -> str:
    """Switch between two people who stand.

    Returns:
        A table: how early contact comes, and how far the gaze passes the new person.
    """
    rows = []
    for controller in ("reactive", "lookahead", "mpc"):
        found = [(measure_attention(log), least_s) for log, least_s in switches(controller, _SWITCH_SEEDS, "reference")]
        late_ms = [1e3 * (each.time_to_contact_after_switch_s - least_s) for each, least_s in found]
        past_deg = [each.switch_overshoot_deg for each, _ in found]
        rows.append([controller, str(len(found)), f"{np.median(late_ms):.0f}", f"{np.max(late_ms):.0f}"])
        rows[-1].append(f"{np.max(past_deg):.2f}")
    head = ["controller", "switches", "contact after the least time, median [ms]", "longest [ms]"]
    return "Switches between two people, neck reference\n\n" + _table([*head, "overshoot, at most [deg]"], rows)


def _row(found: CrowdScore, people_per_s: float) -> list[str]:
    scores = [f"{found.mota:.3f}", f"{found.idf1:.3f}", str(found.switches)]
    return [found.crowd, f"{people_per_s:g}", str(found.people), str(found.at_once), found.tracker, *scores]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join(["| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows)])
