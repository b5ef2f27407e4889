"""Starts what viewers get of a live run, as its settings say."""

from __future__ import annotations

from importlib.util import find_spec
from typing import NamedTuple

from gazempc.live.build import Built
from gazempc.live.clock import RealClock
from gazempc.live.settings import LiveSettings
from gazempc.live.sources.camera.source import CameraSource
from gazempc.live.view.child import ViewProcess
from gazempc.live.view.feed import Feed
from gazempc.live.view.orders import ViewOrders

LAYOUT = "foxglove_layout.json"


class Viewers(NamedTuple):
    """What viewers get.

    Attributes:
        feed: Where moments go.
        process: What is made of them.
        said: What the user is told.
        files: Names of the files that are written beside MCAP files.
    """

    feed: Feed
    process: ViewProcess
    said: tuple[str, ...]
    files: tuple[str, ...]

    @property
    def trouble(self) -> list[str]:
        """What went wrong, one line each; for after the run."""
        lost = self.feed.lost
        said = [f"{lost} moments did not reach viewers and MCAP files, as these were too slow"] if lost else []
        return [*said, *([self.process.problem] if self.process.problem else [])]


def writes_mcap(settings: LiveSettings) -> bool:
    """Whether MCAP files are written: unless told otherwise, if their package is installed."""
    return settings.log == "mcap" or (settings.log is None and find_spec("foxglove") is not None)


def start_viewers(settings: LiveSettings, built: Built) -> Viewers | None:
    """Start the process for viewers.

    Args:
        settings: The settings.
        built: What is made of them; the source is not open yet.

    Returns:
        Where what happens goes; None if nobody wants it.

    Raises:
        SettingsError: If a package is missing, a file cannot be written, or the address cannot be used.
    """
    mcap, source = writes_mcap(settings), built.parts.source
    if not mcap and settings.view is None:
        return None
    pictures = isinstance(source, CameraSource)
    host, port = settings.view_address
    layout = settings.out / LAYOUT if settings.view == "foxglove" else None
    process = ViewProcess(
        ViewOrders(built.about, settings.out if mcap else None, settings.view, host, port, layout, pictures)
    )
    said = process.start()
    feed = Feed(process, built.true_head_base_m, waits=not isinstance(built.parts.clock, RealClock))
    if isinstance(source, CameraSource):
        source.show_to(feed.watch)
    return Viewers(feed, process, said, () if layout is None else (LAYOUT,))
