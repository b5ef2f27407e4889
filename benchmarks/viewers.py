"""Overhead of viewers in a live run: `python -m benchmarks.viewers`.

The same replay runs in real time without viewers, with MCAP files, with the web page and with Foxglove's server,
in turns. Page and server have one client each, which reads all data. Results are medians over the rounds: lateness and
duration of ticks, and the share of the duration that notifies viewers. Results depend on the machine and its load.
"""

from __future__ import annotations

import json
import multiprocessing
import sys
import tempfile
import threading
import time
import urllib.request
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from websockets.sync.client import connect

from gazempc.live.process import fast_switching, without_collection
from gazempc.live.run import LiveRun
from gazempc.live.session import parse
from gazempc.live.settings import LiveSettings
from gazempc.live.setup import build
from gazempc.live.view.viewers import start_viewers
from gazempc.results.moments import Moment

KINDS = {
    "none": ["--log", "npz"],
    "mcap": ["--log", "mcap"],
    "web": ["--log", "npz", "--view", "web"],
    "foxglove": ["--log", "npz", "--view", "foxglove"],
}
PORT = 18765


class Timed(LiveRun):
    """A run that records the computing time of each tick."""

    def __init__(self, *parts: Any) -> None:
        super().__init__(*parts)
        self.took_ms: list[float] = []

    def _tick(self, loop: Any, index: int, now_s: float, due_s: float, stopping: bool) -> None:
        started = time.perf_counter()
        super()._tick(loop, index, now_s, due_s, stopping)
        self.took_ms.append(1e3 * (time.perf_counter() - started))


def read_all(kind: str) -> None:
    """Client that reads all served data, in a separate process."""
    if kind == "web":
        with urllib.request.urlopen(f"http://127.0.0.1:{PORT}/state") as answer:
            while answer.readline():
                pass
    elif kind == "foxglove":
        with connect(f"ws://127.0.0.1:{PORT}", subprotocols=["foxglove.sdk.v1"], max_size=None) as socket:  # type: ignore[list-item]
            while True:
                message = socket.recv()
                if isinstance(message, str) and (received := json.loads(message))["op"] == "advertise":
                    ids = [{"id": each["id"], "channelId": each["id"]} for each in received["channels"]]
                    socket.send(json.dumps({"op": "subscribe", "subscriptions": ids}))


def run_once(kind: str, seconds: float, out: Path) -> list[float]:
    """One run.

    Args:
        kind: The viewers.
        seconds: Duration.
        out: Output folder.

    Returns:
        Milliseconds: median and 99th percentile of the ticks' lateness, the same of their duration, and mean time to
        notify viewers.
    """
    base = ["--source", "replay", "--passes", "99", "--out", str(out), "--view-at", f"127.0.0.1:{PORT}"]
    settings: LiveSettings = parse([*base, *KINDS[kind]])
    setup = build(settings)
    feed = start_viewers(settings, setup)
    notify_ms: list[float] = []

    def listen(moment: Moment) -> None:
        started = time.perf_counter()
        assert feed is not None
        feed.take(moment)
        notify_ms.append(1e3 * (time.perf_counter() - started))

    run = Timed(setup, lambda log, _: log.save(out / "log_000.npz"), [] if feed is None else [listen])
    stop = threading.Event()
    client = multiprocessing.get_context("spawn").Process(target=read_all, args=(kind,), daemon=True)
    client.start()
    time.sleep(3.0)  # until it has connected
    with fast_switching(), without_collection():
        run.run(stop, seconds)
    client.kill()
    client.join()
    if feed is not None:
        feed.close()
    late = run.report.lateness
    taken = np.percentile(run.took_ms, [50, 99]).tolist()
    return [late.percentile_ms(50), late.percentile_ms(99), *taken, sum(notify_ms) / len(run.took_ms)]


def main(rounds: Annotated[int, tyro.conf.arg(help="Number of runs of each kind")] = 5, seconds: float = 10.0) -> None:
    """Run all kinds in turns and print the results.

    Args:
        rounds: Number of runs of each kind.
        seconds: Duration of each run.

    Returns:
        Exit status.
    """
    found: dict[str, list[list[float]]] = {kind: [] for kind in KINDS}
    with tempfile.TemporaryDirectory() as folder:
        for k in range(rounds):
            for kind in KINDS:
                print(f"round {k + 1} of {rounds}: {kind}", file=sys.stderr, flush=True)
                found[kind].append(run_once(kind, seconds, Path(folder)))
    print(f"{'viewers':<10}{'late p50':>10}{'p99':>8}{'tick p50':>10}{'p99':>8}{'notify':>10}   (ms)")
    for kind in KINDS:
        late50, late99, took50, took99, notify_ms = np.median(found[kind], axis=0)
        print(f"{kind:<10}{late50:>10.3f}{late99:>8.3f}{took50:>10.3f}{took99:>8.3f}{notify_ms:>10.4f}")


if __name__ == "__main__":
    tyro.cli(main)
