"""Are people taken for each other? `python -m experiments.people --out out/people`.

Two synthetic walkers cross, 0.3 to 1.5 m behind each other, under each sensor. With `--tracks FOLDER` crowds are made
of recorded head tracks, too. Each is followed by gazempc and by plain nearest neighbour; no sensor tells names. With
`--bags FOLDER` it is judged who is engaged. `--parts` measures looks away from people who stand and walk (`returns`),
their durations and intervals (`schedule`), and switches between two people (`switches`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from experiments.engine.command import Command
from experiments.people.tables import (
    crossing_table,
    crowd_table,
    engaged_table,
    return_table,
    schedule_table,
    switch_table,
)
from gazempc.settings import Settings

Part = Literal["crossing", "returns", "schedule", "switches"]


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
    seconds: float = Field(default=1000.0, ge=30.0, le=3000.0, description="For schedule: length of each talk")
    out: Path = Field(default=Path("out/people"), description="Folder to write to")


def _run(settings: PeopleStudySettings, _: str) -> int:
    measure = {
        "crossing": lambda: crossing_table(settings.sensors, settings.seeds),
        "returns": lambda: return_table(settings.every),
        "schedule": lambda: schedule_table(settings.seconds),
        "switches": switch_table,
    }
    tables = [measure[part]() for part in settings.parts]
    if settings.tracks is not None:
        crowds, rates, sensor = settings.crowds, settings.people_per_s, settings.sensors[0]
        tables.append(crowd_table(settings.tracks, crowds, rates, settings.most, sensor))
    if settings.bags is not None:
        tables.append(engaged_table(settings.bags))
    text = "\n\n".join(tables)
    settings.out.mkdir(parents=True, exist_ok=True)
    path = settings.out / "report.md"
    path.write_text(f"{text}\n", encoding="utf-8")
    print(f"{text}\n\n{path}")
    return 0


main = Command("people", PeopleStudySettings, __doc__, _run).main
