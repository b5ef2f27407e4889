"""What the reports of all experiments share: curves over clips, and what went wrong."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from gazempc.loop.events import MEANINGS
from gazempc.results.page.content import Chart, Curve, Unusual

SHARE_LABEL = "share of clips (%)"


def shares(title: str, x_label: str, clips: Mapping[tuple[str, str], Mapping[str, float]]) -> Chart:
    """For each error the share of clips that have no more than that.

    Args:
        title: What it is about.
        x_label: Name and unit of the error.
        clips: The error by clip, for each label and its CSS colour.

    Returns:
        The chart; a curve farther left is better.
    """
    return Chart(title, x_label, SHARE_LABEL, tuple(_share(*look, of_clip) for look, of_clip in clips.items()))


def _share(label: str, colour: str, of_clip: Mapping[str, float]) -> Curve:
    names = tuple(sorted(of_clip, key=of_clip.__getitem__))
    percent = 100.0 * np.arange(1, len(names) + 1) / max(len(names), 1)
    return Curve(label, colour, np.array([of_clip[name] for name in names], dtype=np.float64), percent, names)


def left_out(reasons: Mapping[str, str]) -> Iterator[Unusual]:
    """Recordings that were left out: recording -> reason."""
    yield from (Unusual(f"left out {name}", reason) for name, reason in reasons.items())


def failures(failed: Iterable[Mapping[str, Any]]) -> Iterator[Unusual]:
    """Runs that failed, each ``recording`` and its ``failed`` reason once."""
    for name, reason in dict.fromkeys((row["recording"], row["failed"]) for row in failed):
        yield Unusual(f"failed {name}", reason)


def survived(faults: Iterable[Mapping[str, Any]]) -> Iterator[Unusual]:
    """Exceptions that runs survived, as of `experiments.engine.replays.all_faults`."""
    for fault in faults:
        parts = ", ".join(str(fault[name]) for name in ("controller", "predictor") if name in fault)
        text = f"{MEANINGS.get(fault['event'], '')}: {fault['error']}".removeprefix(": ")
        what = f"{parts}: {fault['event']}, {fault['count']} x in {fault['runs']} runs"
        yield Unusual(what, text, fault["traceback"])
