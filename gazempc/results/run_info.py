"""Description of a run: recording, parts, neck, sensor, and where its figures come from."""

from __future__ import annotations

import json
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from gazempc.neck.spec import NeckSpec


class RunInfo(BaseModel):
    """Description of a run; it is kept in the log.

    Attributes:
        recording: Name of the recording; of a live run its source.
        kind: Kind of data, such as ``synthetic``; ``live`` for a person who is there now.
        subject: The person.
        group: Route group, None where it is not known.
        controller: Name of the controller.
        predictor: Name of the predictor.
        neck: The neck that moved.
        sensor: The sensor's specification; of a live run its name only.
        seed: Seed of the simulated noise.
        mode: ``replay`` in simulated time, ``live`` on a clock.
        robot: Name of the robot.
        joints: ``true`` if the log holds where the joints were, known in simulation only; ``measured`` if it holds
            what a robot reported.
        settings: All settings of the run.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    recording: str
    kind: str
    subject: str
    group: str | None = None
    controller: str
    predictor: str
    neck: NeckSpec
    sensor: dict[str, Any]
    seed: int = 0
    mode: Literal["replay", "live"] = "replay"
    robot: str = "simulated"
    joints: Literal["true", "measured"] = "true"
    settings: dict[str, Any] = Field(default_factory=dict)

    @property
    def knows_true_head(self) -> bool:
        """Whether the true head is known, as in replays; in a live run it is not."""
        return self.kind != "live"

    def as_json(self) -> str:
        """JSON text, keys sorted: equal runs give equal texts."""
        return json.dumps(self.model_dump(), sort_keys=True)
