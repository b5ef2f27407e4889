"""Which clips an experiment takes, and which the rows of its tables are about, in reading order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gazempc.recordings.readers.labels import ROUTES, STANDING

GROUP_ORDER = (STANDING, *ROUTES)
# What people do in a clip, in reading order; other kinds follow.
KIND_ORDER = ("moving", "starting", "stopping", "waiting", "standing", "sitting", "gesturing", "turning on the spot")


@dataclass(frozen=True)
class Clips:
    """Which clips a row of a table is about: of one group, or of one kind, or all."""

    group: str = "all"
    kind: str = "all"

    def hold(self, row: Mapping[str, Any]) -> bool:
        """Whether a run, with its ``group`` and ``kind``, is among them."""
        return self.group in {"all", row["group"]} and self.kind in {"all", row["kind"]}

    @property
    def labels(self) -> dict[str, str]:
        """Group and kind, as they stand in a row."""
        return {"group": self.group, "kind": self.kind}


def groups_of(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Groups in reading order, ``all`` last."""
    return [*_in_order((row["group"] for row in rows), GROUP_ORDER), "all"]


def clips_of(rows: Iterable[Mapping[str, Any]]) -> list[Clips]:
    """What to make rows of a table about: each group, then each kind, then all.

    Args:
        rows: Runs with ``group`` and ``kind``; None where that is not known.

    Returns:
        The clips of each, in reading order.
    """
    rows = list(rows)
    groups = _in_order((row["group"] for row in rows), GROUP_ORDER)
    kinds = _in_order((row["kind"] for row in rows), KIND_ORDER)
    return [*(Clips(group=group) for group in groups), *(Clips(kind=kind) for kind in kinds), Clips()]


def _in_order(names: Iterable[str | None], order: Sequence[str]) -> list[str]:
    found = {name for name in names if name}
    known = [name for name in order if name in found]
    return [*known, *sorted(found - set(known))]


def sensors_of(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Sensors in the order in which they come."""
    return list(dict.fromkeys(row["sensor"] for row in rows))


def figure_name(figure: str, sensor: str, sensors: Sequence[str]) -> str:
    """File name of a figure about one sensor.

    Args:
        figure: What it shows.
        sensor: The sensor.
        sensors: All that are compared; with more than one the name says which.

    Returns:
        The name of a PNG file.
    """
    told = "".join(c if c.isalnum() or c in "-_" else "_" for c in sensor)
    return f"{figure}_{told}.png" if len(sensors) > 1 else f"{figure}.png"
