"""Figure of one walk from above, with what several predictors said about half a second later."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from experiments.forecast.jobs import Seen
from experiments.forecast.placing import observations_of
from gazempc.results.figures.style import COLOURS, readable
from predictors import Predictor

_EVERY = 6  # frames between drawn forecasts
_AFTER_S = 0.5
_WITHIN_68_OF_PLANE = 2.279  # quantile of chi-square with two degrees of freedom


def draw_example(
    seen: Seen,
    predictors: Mapping[str, Predictor],
    seed: int,
    horizon_s: float,
    path: Path,
) -> None:
    """Draw where each predictor saw the head go, a panel for each, with the stated 68 % ellipse.

    Args:
        seen: The walk as the predictors see it.
        predictors: By name; reset first.
        seed: Seed of the sensor's noise.
        horizon_s: Horizon of the forecasts drawn.
        path: PNG file to write.
    """
    recording, sensor, truth = seen
    end_s = float(recording.times_s[-1])
    walked = truth(np.linspace(0.0, end_s, 400))
    width_inches = 3.3 * len(predictors)
    with readable(width_inches):
        plot = Figure(figsize=(width_inches, 4.0), layout="constrained")
        axes = np.atleast_1d(plot.subplots(1, len(predictors), sharex=True, sharey=True))
        for k, (ax, (name, predictor)) in enumerate(zip(axes, predictors.items(), strict=True)):
            predictor.reset()
            off = []
            ax.plot(walked[:, 0], walked[:, 1], color="0.6", linewidth=2, label="true head")
            for i, observation in enumerate(observations_of(recording, sensor, seed)):
                predictor.update(observation)
                at_s = observation.capture_time_s + horizon_s
                if observation.capture_time_s < _AFTER_S or at_s > end_s:
                    continue
                forecast = predictor.forecast([at_s])
                mean, true = forecast.means_base_m[0], truth([at_s])[0]
                off.append(float(np.linalg.norm(mean - true)))
                if i % _EVERY:
                    continue
                colour = COLOURS[k % len(COLOURS)]
                ax.plot([mean[0], true[0]], [mean[1], true[1]], color="0.3", linewidth=0.8)
                ax.plot(mean[0], mean[1], ".", color=colour)
                values, vectors = np.linalg.eigh(forecast.covariances_m2[0, :2, :2])
                size = 2.0 * np.sqrt(_WITHIN_68_OF_PLANE * np.maximum(values, 0.0))
                angle_deg = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
                ax.add_patch(Ellipse((mean[0], mean[1]), size[1], size[0], angle=angle_deg, color=colour, alpha=0.15))
            ax.set_title(f"{name}\nmean error {1e3 * np.mean(off):.0f} mm", fontsize="medium")
            ax.set_aspect("equal")
            ax.set_xlabel("x (m)")
            ax.grid(alpha=0.3)
        axes[0].set_ylabel("y (m)")
        what = f"{recording.name} ({recording.kind}), sensor {sensor.name}"
        plot.suptitle(f"{what}: forecasts {horizon_s:g} s ahead, seen from above")
        plot.supxlabel(
            "points: forecast; dark lines: to where the head then was; ellipses: stated 68 %",
            fontsize="small",
            color="0.4",
        )
        plot.savefig(path, dpi=150)
