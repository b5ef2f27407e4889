"""Are people taken for each other? `python -m experiments.people --out out/people`.

Two synthetic walkers cross, 0.3 to 1.5 m behind each other, under each sensor. With `--tracks FOLDER` crowds are made
of recorded head tracks, too. Each is followed by gazempc and by plain nearest neighbour; no sensor tells names. With
`--returns` it measures how late contact is back after a look away.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pydantic import Field

from experiments.engine.command import parse, run_command
from experiments.people.crossing import TRACKERS, cross
from experiments.people.crowds import CrowdScore, crowd_of, score
from experiments.people.returns import CONTROLLERS, return_late_s, row
from gazempc.settings import Settings


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
    returns: bool = Field(default=False, description="Measure how late contact is back after a look away, too")
    every: int = Field(default=6, ge=1, description="For that, one of so many synthetic walks")
    out: Path = Field(default=Path("out/people"), description="Folder to write to")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, 2 on bad input.
    """
    return run_command("people", lambda: _run(parse(PeopleStudySettings, "people", __doc__, arguments)))


def _run(settings: PeopleStudySettings) -> int:
    text = crossing_table(settings)
    if settings.tracks is not None:
        text += "\n\n" + crowd_table(settings, settings.tracks)
    if settings.returns:
        text += "\n\n" + return_table(settings)
    settings.out.mkdir(parents=True, exist_ok=True)
    path = settings.out / "report.md"
    path.write_text(f"{text}\n", encoding="utf-8")
    print(f"{text}\n\n{path}")
    return 0


def crossing_table(settings: PeopleStudySettings) -> str:
    """Let pairs cross.

    Args:
        settings: Sensors and number of pairs.

    Returns:
        A table: of how many pairs somebody has the other's identity afterwards, or a new one.
    """
    rows = []
    for sensor in settings.sensors:
        for tracker in TRACKERS:
            each = [cross(seed, sensor, tracker) for seed in range(settings.seeds)]
            swapped, renewed = (100.0 * sum(values) / len(each) for values in zip(*each, strict=True))
            rows.append([Path(sensor).stem, tracker, f"{swapped:.0f}", f"{renewed:.0f}"])
    return f"{settings.seeds} pairs who cross\n\n" + _table(
        ["sensor", "tracker", "identities swapped [%]", "identities renewed [%]"], rows
    )


def crowd_table(settings: PeopleStudySettings, folder: Path) -> str:
    """Follow crowds under the first sensor.

    Args:
        settings: Which crowds.
        folder: Folder of the tracks.

    Returns:
        A table of their scores.
    """
    rows: list[list[str]] = []
    for crowd in settings.crowds:
        for people_per_s in settings.people_per_s:
            walks = crowd_of(folder, crowd, people_per_s, settings.most)
            rows.extend(_row(found, people_per_s) for found in score(crowd, walks, settings.sensors[0], 0))
    return f"Crowds of recorded people, sensor {settings.sensors[0]}\n\n" + _table(
        ["crowd", "people a second", "people", "at once", "tracker", "MOTA", "IDF1", "switches"], rows
    )


def return_table(settings: PeopleStudySettings) -> str:
    """Look away once from each walker.

    Args:
        settings: How many walks.

    Returns:
        A table: how late contact is back.
    """
    rows = [row(name, return_late_s(name, settings.every, "reference")) for name in CONTROLLERS]
    return "Contact back after a look away, neck reference\n\n" + _table(
        ["controller", "median after plan [ms]", "90 % within [ms]", "walks without"], rows
    )


def _row(found: CrowdScore, people_per_s: float) -> list[str]:
    scores = [f"{found.mota:.3f}", f"{found.idf1:.3f}", str(found.switches)]
    return [found.crowd, f"{people_per_s:g}", str(found.people), str(found.at_once), found.tracker, *scores]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join(["| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows)])
