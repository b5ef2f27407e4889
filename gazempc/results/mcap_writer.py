"""An MCAP file that is being written."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

import foxglove

from gazempc.errors import SettingsError
from gazempc.results.mcap_read import ATTACHMENT
from gazempc.results.run_info import RunInfo


class McapWriter:
    """Writes all that is logged to its context; closes the file at the end of a ``with``.

    Args:
        run: What the run is; kept in the file's metadata.
        path: File to write; an old one is replaced.

    Attributes:
        context: Of the channels.

    Raises:
        SettingsError: If the file cannot be written.
    """

    def __init__(self, run: RunInfo, path: Path) -> None:
        self._path = path
        self.context = foxglove.Context()
        try:
            self._writer = foxglove.open_mcap(path, allow_overwrite=True, context=self.context)
        except OSError as error:
            raise SettingsError(f"{path}: cannot be written: {error}") from None
        self.note("gazempc", {"run": run.as_json()})

    def note(self, name: str, about: dict[str, str]) -> None:
        """Write metadata.

        Args:
            name: Their name.
            about: What they say.
        """
        self._writer.write_metadata(name, about)

    def flush(self) -> None:
        """Hand over to the system what has come so far: then it is on disk if this program ends."""
        self._writer.flush()

    def attach(self, log: bytes) -> None:
        """Attach the log itself.

        Args:
            log: What `gazempc.results.log.Log.save` writes.
        """
        self._writer.attach(log_time=0, create_time=0, name=ATTACHMENT, media_type="application/octet-stream", data=log)

    def close(self) -> None:
        """Finish the file.

        Raises:
            SettingsError: If it cannot be written.
        """
        try:
            self._writer.close()
        except (OSError, RuntimeError) as error:
            raise SettingsError(f"{self._path}: cannot be written: {error}") from None

    def __enter__(self) -> McapWriter:
        """The writer itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish the file."""
        self.close()
