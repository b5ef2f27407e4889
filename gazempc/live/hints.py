"""What a check of the tracker's data finds, and the setting that corrects it."""

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
        text: The finding, and the setting that corrects it.
    """

    event: Event
    text: str


@dataclass(frozen=True)
class SetupHints:
    """Names settings.

    Attributes:
        python: Whether the user writes Python (`gazempc.live.gaze.Gaze`), or a command line.
        own_source: Whether the source is one of the user's own, which makes the loop's times itself.
        judges_rate: Whether the rate of frames is judged here; else the source does so.
    """

    python: bool = False
    own_source: bool = False
    judges_rate: bool = True

    def setting(self, group: str, name: str, value: str | float) -> str:
        """A setting of a group, such as ``--mount.unit-m 0.001``."""
        if self.python:
            return f'{group}={{"{name}": {value!r}}}'
        return f"--{group}.{name.replace('_', '-')} {value}"

    def stamps(self, clock: str, unit: str = "s") -> str:
        """How stamps of a clock, in a unit, are read.

        Args:
            clock: ``unix``, ``monotonic``, ``other`` or ``arrival``.
            unit: ``s``, ``ms``, ``us`` or ``ns``.
        """
        if self.own_source:
            known = {"unix": "clock.from_unix_s(SECONDS)", "monotonic": "clock.from_monotonic_s(SECONDS)"}
            time_s = known.get(clock, "such as clock.now_s() minus the latency")
            return f"the source must give the loop's time, {time_s}"
        named = "" if clock == "unix" else f'clock="{clock}"' if self.python else self.setting("stamps", "clock", clock)
        in_unit = "" if unit == "s" else "seconds" if self.python else self.setting("stamps", "unit", unit)
        return f"set {' '.join(filter(None, (named, in_unit)))}"

    @property
    def no_ids(self) -> str:
        """Not to use the tracker's names."""
        return "use_ids=False" if self.python else "--no-use-ids"
