"""The state of attention: whom the robot looks at, why, and whether it looks away just now."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class AttentionState:
    """Whom the robot looks at. Times are on the loop's clock, seconds.

    Attributes:
        person: Number of the person, in the order in which they entered; None for nobody, or where people are not told
            apart.
        person_id: What the tracker calls them; None where it does not say.
        why: ``policy``, ``left`` or ``nobody``, as in `gazempc.people.attention.Attended`; ``one`` where people are not
            told apart; ``ended`` at the end of a run.
        since_s: Since when they are looked at; None before the first decision.
        stays_until_s: Nobody else is looked at before; None for nobody.
        away_why: Why it looks away just now, as in `gazempc.people.aversion.Aversion`; None while it does not.
        away_since_s: Since when there is no contact.
        away_until_s: When contact is due again.
    """

    person: int | None = None
    person_id: str | None = None
    why: str = "nobody"
    since_s: float | None = None
    stays_until_s: float | None = None
    away_why: str | None = None
    away_since_s: float | None = None
    away_until_s: float | None = None
