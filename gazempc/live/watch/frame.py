"""What the watch looks at, and what it finds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from gazempc.loop.events import Event
from gazempc.types import FloatArray


@dataclass(frozen=True)
class Frame:
    """One observation as it arrived, whether it is used or not.

    Attributes:
        arrival_s: When it arrived, on the loop's clock.
        capture_s: Time of capture as read, on the loop's clock.
        sensor_m: Head in the sensor's frame, shape (3,), metres.
        base_m: Head in the base frame, shape (3,), metres; None if it could not be brought there.
        person_id: How the tracker calls the person.
    """

    arrival_s: float
    capture_s: float
    sensor_m: FloatArray
    base_m: FloatArray | None
    person_id: str | None


def shown(value: float) -> str:
    """A number for people: three digits, and no powers of ten where there are more."""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


class Finding(NamedTuple):
    """Something that is probably wrong.

    Attributes:
        event: Its kind.
        text: What it looks like, and what mends it.
    """

    event: Event
    text: str
