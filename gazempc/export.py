"""Write a log in a format of other programs: `python -m gazempc.export out/walk/mpc.npz --to csv`.

csv and parquet: one file each for ticks, observations, forecasts and events. mcap: one file for Foxglove, rerun and
other viewers, which is also a log that gazempc reads.
"""

from __future__ import annotations

import csv
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import tyro
from pydantic import BaseModel, Field

from gazempc.command import TYRO_CONFIG, run_interruptible
from gazempc.errors import importing
from gazempc.files.whole import whole
from gazempc.results.log import Log
from gazempc.results.log_files import load_log, write_mcap
from gazempc.results.tables import Columns, log_tables


class ExportSettings(BaseModel):
    """Settings of `python -m gazempc.export`."""

    log: tyro.conf.Positional[Path] = Field(description="A log: .npz or .mcap")
    to: Literal["csv", "parquet", "mcap"] = Field(description="Format")
    out: Annotated[Path | None, tyro.conf.arg(metavar="PATH")] = Field(
        default=None, description="File to write, without the ending; default: beside the log, under its name"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, or 2 on bad input.
    """
    settings = tyro.cli(
        ExportSettings, config=TYRO_CONFIG, args=arguments, prog="python -m gazempc.export", description=__doc__
    )
    return run_interruptible("gazempc.export", lambda: _work(settings), "")


def _work(settings: ExportSettings) -> int:
    stem = settings.out or settings.log.with_suffix("")
    for path in export(load_log(settings.log), settings.to, stem):
        print(path)
    return 0


def export(log: Log, to: Literal["csv", "parquet", "mcap"], stem: Path) -> list[Path]:
    """Write a log in another format.

    Args:
        log: The log.
        to: The format.
        stem: Path without ending; tables add ``_ticks``, ``_observations``, ``_forecasts`` and ``_events``.

    Returns:
        The files that were written.

    Raises:
        MissingOptionalDependencyError: If a package is missing.
        OSError: If a file cannot be written.
    """
    if to == "mcap":
        path = stem.with_name(f"{stem.name}.mcap")
        write_mcap(log, path)
        return [path]
    write = _write_csv if to == "csv" else _write_parquet
    tables = {stem.with_name(f"{stem.name}_{name}.{to}"): table for name, table in log_tables(vars(log)).items()}
    for path, columns in tables.items():
        write(columns, path)
    return list(tables)


def _write_csv(columns: Columns, path: Path) -> None:
    # Shortest round-trip representation: numbers are read back to the last bit; an empty cell for NaN.
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    with whole(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(
            [["" if isinstance(value, float) and math.isnan(value) else value for value in row] for row in rows]
        )


def _write_parquet(columns: Columns, path: Path) -> None:
    with importing("writing Parquet files", "pyarrow", "parquet"):
        import pyarrow as pa  # noqa: PLC0415
        import pyarrow.parquet as pq  # noqa: PLC0415
    with whole(path) as part:
        pq.write_table(pa.table(dict(columns)), part)


if __name__ == "__main__":
    sys.exit(main())
