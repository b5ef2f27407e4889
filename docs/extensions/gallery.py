"""Thumbnails of the gallery: runs each script of `examples/` and draws what it did."""

from __future__ import annotations

import contextlib
import io
import os
import runpy
import sys
import tempfile
from pathlib import Path
from typing import Any

import thumbnails
from sphinx.application import Sphinx
from sphinx.util import logging
from thumbnails import Draw

import gazempc
from gazempc import Log

EXAMPLES = {path.stem: path for path in (Path(__file__).resolve().parents[2] / "examples").rglob("*.py")}
DRAWN: dict[str, Draw] = {
    "compare_gazes": thumbnails.error_over_time,
    "dynamixel_pan_tilt": thumbnails.error_over_time,
    "fetch": thumbnails.error_over_time,
    "outside_predictor": thumbnails.error_over_time,
    "ocp": thumbnails.planned_angles,
    "own_controller": thumbnails.error_over_time,
    "own_predictor": thumbnails.error_over_time,
    "own_recording": thumbnails.from_above,
    "own_robot": thumbnails.command_and_joint,
    "own_tracker": thumbnails.command_and_joint,
    "pr2": thumbnails.command_and_joint,
    "ptz_camera": thumbnails.error_over_time,
    "reachy_mini": thumbnails.error_over_time,
    "read_a_log": thumbnails.command_and_joint,
    "receptionist": thumbnails.who_is_looked_at,
    "receptionist_replay": thumbnails.who_is_looked_at,
    "sweep_settings": thumbnails.error_against_acceleration,
}
# Where a command writes the log of a live run.
_LIVE_LOG = Path("out/live/log_000.npz")


def run_example(path: Path) -> list[Log]:
    """Run a script in an empty folder.

    Args:
        path: The script.

    Returns:
        Logs of its replays, or of its live run.
    """
    logs: list[Log] = []
    replay = gazempc.replay

    def kept(*arguments: Any, **settings: Any) -> Log:
        logs.append(replay(*arguments, **settings))
        return logs[-1]

    before = Path.cwd(), sys.argv, list(sys.path)
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        try:
            os.chdir(folder)
            sys.argv, gazempc.replay = [str(path)], kept
            sys.path.insert(0, str(path.parent))
            with contextlib.suppress(SystemExit):
                names = runpy.run_path(str(path), run_name="__main__")
                logs = logs or [names[result] for result in ("log", "motion") if result in names]
            return logs or [gazempc.load_log(_LIVE_LOG)]
        finally:
            os.chdir(before[0])
            sys.argv, sys.path[:], gazempc.replay = before[1], before[2], replay


def make_thumbnails(app: Sphinx) -> None:
    """Draw those that are not there, or are older than their script."""
    for name, draw in DRAWN.items():
        script, picture = EXAMPLES[name], Path(app.srcdir) / "_thumbnails" / f"{name}.png"
        if not picture.exists() or picture.stat().st_mtime < script.stat().st_mtime:
            logging.getLogger(__name__).info("running %s for its thumbnail", script.name)
            thumbnails.thumbnail(run_example(script), draw, picture)


def setup(app: Sphinx) -> None:
    """Draw before the pages are read."""
    app.connect("builder-inited", make_thumbnails)
