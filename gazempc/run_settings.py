"""Settings of the command `gazempc run`, from command line and YAML file."""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import tyro
from pydantic import Field

from gazempc.errors import SettingsError, shown
from gazempc.files.documents import parse_yaml, read_settings
from gazempc.settings import GAZES, GazeChoice
from gazempc.sim.replay import ReplaySettings
from gazempc.specfiles import checked


class RunSettings(ReplaySettings):
    """Settings of `python -m gazempc.run`."""

    replay: Annotated[str | None, tyro.conf.arg(metavar="NAME|PATH")] = Field(
        default=None,
        description="Recording: subject03_R4 (synthetic), a table (.csv, .tsv, .txt, .parquet, .mvnx), a .json or .bvh "
        "file, or the folder of a ROS 2 bag or of OpenPose; a log (.npz, .mcap) is re-evaluated",
    )
    list: bool = Field(default=False, description="Print all included recordings, necks and sensors")
    controllers: tuple[GazeChoice, ...] = Field(
        default=GAZES,
        min_length=1,
        description="Controllers to compare; mpc+perfect is the mpc with the true future; module:Class for your own",
    )
    log: Literal["npz", "mcap"] = Field(
        default="npz",
        description="Format of the logs; mcap: beside .npz, with plans, for Foxglove, rerun and other viewers",
    )
    noise_seeds: int | None = Field(
        default=None,
        ge=1,
        le=1000,
        description="Number of seeds of the noise, from --seed on; default: 8, or as many as fit into ten "
        "seconds. Logs and figures are from the first seed",
    )
    out: Path | None = Field(
        default=None, description="Folder for all files; replaces an earlier run; default: out/<recording>"
    )
    figures: bool = Field(default=True, description="Draw figures and the animation")
    config: Path | None = Field(
        default=None, description="YAML file with any of these settings; the command line has priority"
    )


def load_settings(path: Path) -> RunSettings:
    """Read settings from a YAML file.

    Args:
        path: File with a mapping of settings; nested ones as nested mappings.

    Returns:
        The settings; defaults where the file has no value.

    Raises:
        SettingsError: If the file cannot be read, or has unknown keys or invalid values; lists all, with suggestions.
    """
    data = parse_yaml(read_settings(path), str(path))
    if not isinstance(data, dict | None):
        raise SettingsError(f"{path}: expected a mapping of settings such as 'neck: slow', got {shown(data)}")
    return checked(RunSettings, data or {}, str(path))


def config_path(words: Sequence[str]) -> Path | None:
    """The file given by `--config`.

    Args:
        words: Command line without the program's name.

    Returns:
        The file; None without the option.
    """
    parser = ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--config", type=Path, nargs="?")
    path: Path | None = parser.parse_known_args(words)[0].config
    return path
