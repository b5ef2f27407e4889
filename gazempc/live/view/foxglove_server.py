"""Serves the channels of a run to Foxglove, over its WebSocket."""

from __future__ import annotations

import foxglove

from gazempc.errors import SettingsError
from gazempc.live.view.orders import named
from gazempc.results.mcap_channels import Channels
from gazempc.results.moments import Moment
from gazempc.results.run_info import RunInfo


class FoxgloveServer:
    """The server, in threads of the SDK. A client that is slow misses the oldest messages.

    Args:
        run: What the run is.
        host: Address.
        port: Port; 0 for any that is free.

    Attributes:
        url: What Foxglove is told to open.

    Raises:
        SettingsError: If the address cannot be used.
    """

    def __init__(self, run: RunInfo, host: str, port: int) -> None:
        # Channels end with their context.
        self._context = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name=f"gazempc {run.recording}", host=host, port=port, context=self._context
            )
        except (OSError, RuntimeError) as error:
            raise SettingsError(f"--view-at {host}:{port}: {error}; another port: --view-at {host}:PORT") from None
        self.url = f"ws://{named(host)}:{self._server.port}"
        self._channels = Channels(run, self._context)

    def take(self, moment: Moment) -> None:
        """Send what happened.

        Args:
            moment: What.
        """
        self._channels.write(moment)

    def close(self) -> None:
        """Close all connections."""
        self._server.stop()
