"""MCAP files that are written while a run goes on: one beside each log."""

from __future__ import annotations

from collections import deque
from pathlib import Path

from gazempc.live.view.orders import LogKept
from gazempc.results.mcap_channels import Channels, McapWriter
from gazempc.results.moments import CutMoment, Moment, TickMoment
from gazempc.results.run_info import RunInfo

# So much a run that is killed may lose.
_FLUSH_EVERY_S = 2.0


class McapFiles:
    """Writes one file after the other. A file is complete once its log is kept: then the log is attached.

    Args:
        run: What the run is.
        folder: Where they go: ``log_000.mcap`` and so on.

    Raises:
        SettingsError: If the first file cannot be written.
    """

    def __init__(self, run: RunInfo, folder: Path) -> None:
        self._run, self._folder = run, folder
        self._number = 0
        self._lost = 0
        self._begun = False
        self._flush_s = 0.0
        self._complete: deque[McapWriter] = deque()
        self._open: tuple[McapWriter, Channels] | None = self._next()

    def take(self, moment: Moment | LogKept) -> None:
        """Write what happened.

        Args:
            moment: What.

        Raises:
            SettingsError: If a file cannot be written.
            OSError: If a log cannot be read.
        """
        if isinstance(moment, LogKept):
            self._finish(moment)
        elif not isinstance(moment, CutMoment):
            self._open = self._open or self._next()
            writer, channels = self._open
            channels.write(moment)
            self._begun = True
            if isinstance(moment, TickMoment) and moment.time_s >= self._flush_s:
                self._flush_s = moment.time_s + _FLUSH_EVERY_S
                writer.flush()
        elif self._open is not None:
            self._complete.append(self._open[0])
            self._open = None

    def close(self) -> None:
        """Close what is open. Without its log a file has all channels; one of a run that never began is removed."""
        if self._open is not None:
            self._complete.append(self._open[0])
        while self._complete:
            self._complete.popleft().close()
        if not self._begun:
            self._path(0).unlink(missing_ok=True)

    def _next(self) -> tuple[McapWriter, Channels]:
        writer = McapWriter(self._run, self._path(self._number))
        self._number += 1
        return writer, Channels(self._run, writer.context)

    def _path(self, number: int) -> Path:
        return self._folder / f"log_{number:03}.mcap"

    def _finish(self, kept: LogKept) -> None:
        writer = self._complete.popleft()
        lost, self._lost = kept.lost - self._lost, kept.lost
        writer.note("gazempc_lost", {"moments": str(lost)})
        writer.attach(kept.path.read_bytes())
        writer.close()
