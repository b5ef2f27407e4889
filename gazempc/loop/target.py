"""The target of a run: one person or one of several, and the times of looking away."""

from __future__ import annotations

import copy
from typing import Any

from gazempc.loop.attended import AttendedPeople
from gazempc.loop.build import Person, make_predictor
from gazempc.loop.looking_away import LookingAway
from gazempc.loop.track import PersonTrack, Target
from gazempc.neck.spec import NeckSpec
from gazempc.people.attention import Attention
from gazempc.people.company import Cues
from gazempc.people.policies import make_policy
from gazempc.people.schedule import LookAways
from gazempc.settings import GazeSettings
from predictors import Predictor


def make_target(
    choice: str | Predictor,
    ready: Predictor,
    neck: NeckSpec,
    settings: GazeSettings,
    options: dict[str, Any],
    cues: Cues | None = None,
) -> Target:
    """Make the target of a run whose future is unknown.

    Args:
        choice: How the predictor was chosen; an object is copied for each of several people.
        ready: The predictor.
        neck: The neck.
        settings: Policy of attention, and rhythm of looking away.
        options: Parameters of parts of your own.
        cues: Cues of a dialogue program.

    Returns:
        The target.

    Raises:
        SettingsError: If the policy cannot be made.
    """
    target: Target = PersonTrack(ready, settings.loop)
    if settings.attend is not None:

        def make() -> Predictor:
            return (
                make_predictor(choice, settings, Person(), options) if isinstance(choice, str) else copy.deepcopy(ready)
            )

        attention = Attention(make_policy(settings.attend, options), settings.attention)
        target = AttendedPeople(make, attention, settings.loop, settings.framing.subject == "all")
    if settings.attend is None and settings.look_away.rhythm == "no":
        return target
    mode = "told" if settings.look_away.rhythm == "no" else settings.look_away.rhythm
    return LookingAway(target, LookAways(neck, mode, settings.look_away.seed), cues)
