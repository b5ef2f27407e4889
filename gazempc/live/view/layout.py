"""The layout for Foxglove: which panels show what of a run."""

from __future__ import annotations

from pathlib import Path

from foxglove.layouts import (
    BaseRendererGridLayerSettings,
    BaseRendererSceneUpdateTopicSettings,
    ImageConfig,
    ImageModeConfig,
    ImagePanel,
    Layout,
    LogConfig,
    LogPanel,
    PlotConfig,
    PlotPanel,
    PlotSeries,
    SplitContainer,
    SplitItem,
    ThreeDeeCameraState,
    ThreeDeeConfig,
    ThreeDeePanel,
)

from gazempc.neck.spec import NeckSpec

_SHOWN_S = 30.0


def write_layout(path: Path, neck: NeckSpec, camera: bool) -> None:
    """Write the layout file; Foxglove takes it by *Import from file*.

    Args:
        path: File to write.
        neck: The neck, whose joints are plotted.
        camera: Whether there are pictures of a camera.
    """
    scene = ThreeDeePanel(
        title="Person, forecast and gaze",
        config=ThreeDeeConfig(
            follow_tf="base",
            fixed_frame="base",
            camera_state=ThreeDeeCameraState(distance=8.0, perspective=True, phi=50.0, theta_offset=90.0),
            layers={"grid": BaseRendererGridLayerSettings(frame_id="base", size=10.0, divisions=10.0)},
            topics={"/scene": BaseRendererSceneUpdateTopicSettings(visible=True)},
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
    events = LogPanel(title="Events", config=LogConfig(topic_to_render="/events"))
    picture = ImagePanel(title="Camera", config=ImageConfig(image_mode=ImageModeConfig(image_topic="/camera")))
    left = [SplitItem(proportion=2, content=scene), SplitItem(content=events)]
    right = [SplitItem(content=each) for each in ([picture] if camera else []) + [error, times, joints]]
    layout = Layout(
        content=SplitContainer(
            direction="row",
            items=[
                SplitItem(content=SplitContainer(direction="column", items=left)),
                SplitItem(content=SplitContainer(direction="column", items=right)),
            ],
        )
    )
    path.write_text(layout.to_json() + "\n", encoding="utf-8")


def _plot(title: str, paths: dict[str, str]) -> PlotPanel:
    series = [PlotSeries(label=label, value=value, enabled=True) for label, value in paths.items()]
    return PlotPanel(title=title, config=PlotConfig(paths=series, following_view_width=_SHOWN_S))
