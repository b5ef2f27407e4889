"""Logs of one run that follow each other, as one log."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from gazempc.results.log import Fault, Log

_ONCE = ("run", "forecast_horizon_s", "faults")


def join_logs(logs: Sequence[Log]) -> Log:
    """Join logs of one run.

    Args:
        logs: At least one, in the order of time.

    Returns:
        One log; an event that lasted over an end begins once more after it.

    Raises:
        ValueError: If there is none.
    """
    if not logs:
        raise ValueError("nothing to join: needed is at least one log")
    joined: dict[str, Any] = {
        f.name: np.concatenate([getattr(log, f.name) for log in logs]) for f in fields(Log) if f.name not in _ONCE
    }
    return replace(logs[0], **joined, faults=merge_faults(fault for log in logs for fault in log.faults))


def merge_faults(faults: Iterable[Fault]) -> tuple[Fault, ...]:
    """Faults of several logs.

    Args:
        faults: In the order of time.

    Returns:
        Each event once: its first exception, and how often it came in all.
    """
    merged: dict[str, Fault] = {}
    for fault in faults:
        first = merged.get(fault.event)
        merged[fault.event] = fault if first is None else replace(first, count=first.count + fault.count)
    return tuple(merged.values())
