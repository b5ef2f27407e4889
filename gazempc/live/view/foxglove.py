"""Functions of the extra `view`: MCAP files, the server of channels for Foxglove, and the layout of its panels."""

from __future__ import annotations

from collections import deque
from pathlib import Path

import foxglove
from foxglove import layouts

from gazempc.errors import SettingsError
from gazempc.live.sources.wires import named
from gazempc.neck.spec import NeckSpec
from gazempc.results.log import RunInfo
from gazempc.results.mcap_channels import Channels, McapWriter
from gazempc.results.moments import CutMoment, Moment, TickMoment


class FoxgloveServer:
    """The server, in threads of the SDK. A slow client misses the oldest messages.

    Args:
        run: Description of the run.
        host: Address.
        port: Port; 0 for any free one.

    Attributes:
        url: Address for Foxglove.
        take: Sends a moment.
        close: Closes all connections.

    Raises:
        SettingsError: If the address cannot be used.
    """

    def __init__(self, run: RunInfo, host: str, port: int) -> None:
        # Channels end with their context.
        self._context = foxglove.Context()
        try:
            name = f"gazempc {run.recording}"
            self._server = foxglove.start_server(name=name, host=host, port=port, context=self._context)
        except (OSError, RuntimeError) as error:
            raise SettingsError(f"--view-at {host}:{port}: {error}; another port: --view-at {host}:PORT") from None
        self.url = f"ws://{named(host)}:{self._server.port}"
        self.take, self.close = Channels(run, self._context).write, self._server.stop


_SHOWN_S = 30.0


def write_layout(path: Path, neck: NeckSpec, camera: bool) -> None:
    """Write the layout file for *Import from file* of Foxglove.

    Args:
        path: File to write.
        neck: The neck, whose joints are plotted.
        camera: Whether the run has pictures of a camera.
    """
    scene = layouts.ThreeDeePanel(
        title="Person, forecast and gaze",
        config=layouts.ThreeDeeConfig(
            follow_tf="base",
            fixed_frame="base",
            camera_state=layouts.ThreeDeeCameraState(distance=8.0, perspective=True, phi=50.0, theta_offset=90.0),
            layers={"grid": layouts.BaseRendererGridLayerSettings(frame_id="base", size=10.0, divisions=10.0)},
            topics={"/scene": layouts.BaseRendererSceneUpdateTopicSettings(visible=True)},
        ),
    )
    error = _plot(
        "Gaze error, degrees",
        {"to the true head": "/metrics.gaze_error_deg", "to the observed head": "/metrics.gaze_to_observed_deg"},
    )
    times = _plot(
        "Milliseconds",
        {"from capture to command": "/metrics.latency_ms", "lateness of ticks": "/metrics.late_ms"},
    )
    joints = _plot(
        "Joints and commands, radians",
        {f"{name} {kind}": f"/ticks.{kind}_{name}_rad" for name in neck.joint_names for kind in ("joint", "command")},
    )
    events = layouts.LogPanel(title="Events", config=layouts.LogConfig(topic_to_render="/events"))
    picture = layouts.ImagePanel(
        title="Camera", config=layouts.ImageConfig(image_mode=layouts.ImageModeConfig(image_topic="/camera"))
    )
    left = [layouts.SplitItem(proportion=2, content=scene), layouts.SplitItem(content=events)]
    right = [layouts.SplitItem(content=each) for each in ([picture] if camera else []) + [error, times, joints]]
    columns = [layouts.SplitContainer(direction="column", items=items) for items in (left, right)]
    row = layouts.SplitContainer(direction="row", items=[layouts.SplitItem(content=each) for each in columns])
    path.write_text(layouts.Layout(content=row).to_json() + "\n", encoding="utf-8")


def _plot(title: str, paths: dict[str, str]) -> layouts.PlotPanel:
    series = [layouts.PlotSeries(label=label, value=value, enabled=True) for label, value in paths.items()]
    return layouts.PlotPanel(title=title, config=layouts.PlotConfig(paths=series, following_view_width=_SHOWN_S))


# Maximum loss of data if the run is killed.
_FLUSH_EVERY_S = 2.0


class McapFiles:
    """Writes a sequence of files. A file is complete when its log is stored and attached.

    Args:
        run: Description of the run.
        folder: Folder of the files ``log_000.mcap`` and so on.

    Raises:
        SettingsError: If the first file cannot be written.
    """

    def __init__(self, run: RunInfo, folder: Path) -> None:
        self._run, self._folder = run, folder
        self._number = 0
        self._begun = False
        self._flush_s = 0.0
        # Oldest first; the last one is open while there are channels.
        self._writers: deque[McapWriter] = deque()
        self._channels: Channels | None = self._next()

    def take(self, moment: Moment | Path) -> None:
        """Write a moment.

        Args:
            moment: The moment, or the ``.npz`` file of a complete log, whose name the MCAP file beside it has.

        Raises:
            SettingsError: If a file cannot be written.
            OSError: If a log cannot be read.
        """
        if isinstance(moment, Path):
            writer = self._writers.popleft()
            writer.attach(moment.read_bytes())
            writer.close()
        elif isinstance(moment, CutMoment):
            self._channels = None
        else:
            self._channels = self._channels or self._next()
            self._channels.write(moment)
            self._begun = True
            if isinstance(moment, TickMoment) and moment.time_s >= self._flush_s:
                self._flush_s = moment.time_s + _FLUSH_EVERY_S
                self._writers[-1].flush()

    def close(self) -> None:
        """Close the open file. Without its log a file has all channels; one without a tick is removed."""
        while self._writers:
            self._writers.popleft().close()
        if not self._begun:
            self._path(0).unlink(missing_ok=True)

    def _next(self) -> Channels:
        self._writers.append(McapWriter(self._run, self._path(self._number)))
        self._number += 1
        return Channels(self._run, self._writers[-1].context)

    def _path(self, number: int) -> Path:
        return self._folder / f"log_{number:03}.mcap"
