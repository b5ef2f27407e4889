"""Settings, command line, exit status and messages common to all commands; recordings, sensors and parts by name."""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, Self, TypeVar

import tyro
from pydantic import BaseModel, Field, ValidationError

from experiments.engine.job import Row
from gazempc import command
from gazempc.errors import GazempcError, MissingOptionalDependencyError, SettingsError, shown, suggest
from gazempc.loop.build import walker_model
from gazempc.part_options import check_options, options_for, take_options
from gazempc.parts import CONTROLLER, PREDICTOR, find, is_own
from gazempc.recordings.load import ENDINGS_IN_FOLDERS, is_recording, is_recording_folder
from gazempc.recordings.synthetic.everyday import everyday_names
from gazempc.recordings.synthetic.walks import synthetic_names
from gazempc.settings import DEFAULT_PREDICTOR, PredictorChoice, Settings, WalkerSettings
from gazempc.sim.sensor import SensorSpec, load_sensor
from gazempc.specfiles import explain

S = TypeVar("S", bound=BaseModel)
# Default sensors, one of which a recording selects.
_DEFAULT_SENSORS = ("reference", "recorded")
_SETS = {"synthetic": synthetic_names, "everyday": everyday_names}


class WorkSettings(Settings):
    """Worker processes of a command, and the folder of its results."""

    jobs: int = Field(default=os.cpu_count() or 1, ge=1, description="Worker processes on this machine")
    dask: str | None = Field(
        default=None, description="Scheduler of a dask.distributed cluster for the jobs, such as tcp://host:8786"
    )
    out: Path = Field(default=Path("out"), description="Output folder; an interrupted command resumes from it")

    @classmethod
    def of(cls, name: str, values: dict[str, Any]) -> Self:
        """Settings from keyword arguments.

        Args:
            name: Function name, for messages.
            values: Value by field.

        Raises:
            SettingsError: With all unknown fields and invalid values.
        """
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            raise SettingsError(explain(error, name, cls)) from None

    def saved(self, *also: str) -> dict[str, Any]:
        """Settings for a summary, without worker settings, which do not affect the results.

        Args:
            also: Further fields to exclude.
        """
        return self.model_dump(mode="json", exclude={*WorkSettings.model_fields, *also})


class ChoiceSettings(WorkSettings):
    """Settings of a comparison over recordings."""

    recordings: tuple[str, ...] = Field(
        min_length=1, description="'synthetic' (14 x 6), 'everyday' (14 x 5), folders, files or synthetic names"
    )
    predictors: tuple[PredictorChoice | Literal["default"], ...] = Field(
        default=("default",), min_length=1, description="Forecasts; default is the run command's; module:Class"
    )
    sensors: tuple[str, ...] = Field(
        default=(), description="Shipped sensors or .toml files; default: by each recording"
    )
    walker: WalkerSettings = WalkerSettings()
    options: Annotated[dict[str, Any], tyro.conf.Suppress] = Field(
        default={}, description="Options of user-defined parts: --options.KEY VALUE, for a parameter of the constructor"
    )

    def recordings_in_place(self) -> dict[str, str]:
        """Result of `in_place` by recording, from `find_recordings`."""
        return {name: in_place(name) for name in find_recordings(self.recordings)}

    def checked_predictors(self, *controllers: str) -> list[str]:
        """Distinct names of the predictors, after validation.

        Args:
            controllers: Controllers to check with them.

        Raises:
            GazempcError: If a part or a fitted model is missing, or no part has an option.
        """
        predictors = list(dict.fromkeys(DEFAULT_PREDICTOR if p == "default" else p for p in self.predictors))
        check_parts(controllers, predictors, self.options)
        check_fitted(self.walker)
        return predictors


def check_fitted(walker: WalkerSettings) -> None:
    """Raise SettingsError if the fitted models cannot be read."""
    if walker.fitted is not None:
        walker_model(walker.fitted, "")


def find_recordings(words: Sequence[str]) -> list[str]:
    """Names and paths of recordings.

    Args:
        words: ``synthetic`` for all synthetic walks, ``everyday`` for the synthetic people who stand, start and stop, a
            folder for all recordings in it (except ``index.csv``), a file, a folder that is one recording, or a
            synthetic name.

    Returns:
        Distinct names and paths in the given order; files of a folder sorted.

    Raises:
        GazempcError: With all words that do not exist, or are folders without recordings.
    """
    found: list[str] = []
    problems = []
    for word in words:
        path = Path(word)
        try:
            path.exists()
        except (OSError, ValueError) as error:  # such as a name that is too long or contains a null byte
            why = error.strerror if isinstance(error, OSError) else error
            problems.append(f"{shown(word, 80)}: not a recording; {why}")
            continue
        if word in _SETS:
            found += _SETS[word]()
        elif path.is_dir() and not is_recording_folder(path):
            files = sorted(p for p in path.iterdir() if is_recording(p))
            found += [str(p) for p in files]
            if not files:
                problems.append(f"{word}: no recordings in this folder (accepted: {', '.join(ENDINGS_IN_FOLDERS)})")
        elif path.exists() or any(word in names() for names in _SETS.values()):
            found.append(word)
        else:
            names = [*_SETS, *(name for names in _SETS.values() for name in names())]
            hint = suggest(word, names).rpartition("accepted: ")[0] + f"accepted: {', '.join(sorted(_SETS))}"
            hint = hint if "." not in word and "/" not in word else "no such file or folder"
            problems.append(f"{word}: not a recording; {hint}, a synthetic name, a file or a folder")
    if problems:
        raise GazempcError("\n".join(problems))
    return list(dict.fromkeys(found))


def labels_of(recordings: Sequence[str]) -> list[str]:
    """Labels of recordings, each once: the stem of the file, or its path without ending if files share the stem."""
    stems = Counter(Path(recording).stem for recording in recordings)
    return [path.stem if stems[path.stem] == 1 else str(path.with_suffix("")) for path in map(Path, recordings)]


def in_place(recording: str) -> str:
    """Identifier of a recording independent of the working directory: absolute path, or synthetic name."""
    path = Path(recording)
    return str(path.resolve()) if path.exists() else recording


def sensors_by_name(chosen: str | None) -> dict[str, SensorSpec]:
    """The chosen sensor, or all default sensors.

    Args:
        chosen: Shipped sensor or .toml file; None for each recording's default.

    Returns:
        Sensor by name.

    Raises:
        SettingsError: If the sensor does not exist.
    """
    return {name: load_sensor(name) for name in ((chosen,) if chosen else _DEFAULT_SENSORS)}


def each_sensor(chosen: Sequence[str]) -> dict[str | None, dict[str, SensorSpec]]:
    """The sensors of a comparison.

    Args:
        chosen: Shipped sensors or .toml files; empty for each recording's default.

    Returns:
        Result of `sensors_by_name` for each; under None if none was chosen.

    Raises:
        SettingsError: If a sensor does not exist, or two have the same name, which would be ambiguous in tables.
    """
    found = {name: sensors_by_name(name) for name in dict.fromkeys(chosen or (None,))}
    first: dict[str, str] = {}
    for word, sensor in ((word, sensors[word]) for word, sensors in found.items() if word is not None):
        if first.setdefault(sensor.name, word) != word:
            raise SettingsError(f"sensors {first[sensor.name]} and {word} have the same name, {sensor.name!r}")
    return found


def check_parts(controllers: Iterable[str], predictors: Iterable[str], options: Mapping[str, Any]) -> None:
    """Check that custom parts can be imported, and that each option applies to a part.

    Args:
        controllers: Shipped names, or ``module:Class``.
        predictors: The same.
        options: Values by parameter, see `gazempc.part_options.options_for`.

    Raises:
        SettingsError: If a check fails.
    """
    parts = [*((CONTROLLER, choice) for choice in controllers), *((PREDICTOR, choice) for choice in predictors)]
    for kind, choice in parts:
        if is_own(choice):
            find(kind, choice)
    check_options(parts, options)


def options_of(controller: str, predictor: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Options that apply to one of two parts: only these identify a run.

    Args:
        controller: A shipped name, or ``module:Class``.
        predictor: The same.
        options: Values by ``kind.parameter``, of all parts.

    Returns:
        Values by ``kind.parameter``.
    """
    return {
        f"{kind.name}.{name}": value
        for kind, choice in ((CONTROLLER, controller), (PREDICTOR, predictor))
        for name, value in options_for(kind, choice, options).items()
    }


def name_parts(rows: Iterable[Row], part: str) -> None:
    """Replace ``module:Class`` in rows by the parts' own names.

    Two parts of the same name keep ``module:Class``.

    Args:
        rows: Rows with the chosen part under `part`, if any, and its name under ``<part>_name`` if the run is complete;
            the latter entry is removed.
        part: ``controller`` or ``predictor``.
    """
    rows = list(rows)
    given = [(row, row.pop(f"{part}_name", None)) for row in rows]
    names = {row[part]: name for row, name in given if name is not None and part in row}
    taken = Counter(names.values())
    for row in (row for row in rows if part in row):
        name = names.get(row[part], row[part])
        if taken[name] == 1:
            row[part] = name


@dataclass(frozen=True)
class Command(Generic[S]):
    """A command line.

    Attributes:
        name: Python runs ``experiments.<name>``.
        model: The settings; a model with a field ``options`` takes ``--options.KEY VALUE``.
        about: Description, for ``--help``.
        work: Function of the settings and the command line, which returns the exit status.
    """

    name: str
    model: type[S]
    about: str | None
    work: Callable[[S, str], int]

    def main(self, arguments: Sequence[str] | None = None) -> int:
        """Run the command line.

        Args:
            arguments: Command line without the program's name; default: the process's.

        Returns:
            Exit status: 0; 1 after a limit violation; 4 after a failed job; otherwise from `run_interruptible`.
        """
        words = list(sys.argv[1:] if arguments is None else arguments)
        line = command.command_line(f"experiments.{self.name}", words)
        return command.run_interruptible(self.name, lambda: self.work(self.parse(words), line))

    def parse(self, words: list[str]) -> S:
        """Parse a command line.

        Args:
            words: Command line without the program's name.

        Returns:
            The settings.

        Raises:
            SettingsError: If an option has no value.
            SystemExit: If the command line is invalid (status 2) or requests help (status 0).
        """
        own: dict[str, Any] = {}
        if "options" in self.model.model_fields:
            words, own["options"] = take_options(words)
        prog = f"python -m experiments.{self.name}"
        found = tyro.cli(self.model, config=command.TYRO_CONFIG, args=words, prog=prog, description=self.about)
        return found.model_copy(update=own)


def check_optuna(what: str) -> None:
    """Raise MissingOptionalDependencyError, with `what` needs Optuna, if it is not installed."""
    if find_spec("optuna") is None:
        raise MissingOptionalDependencyError(what, "optuna", "tune")


def exit_status(left_limits: bool, failed: bool) -> int:
    """Exit status of a command after its jobs.

    Args:
        left_limits: Whether any job violated a limit.
        failed: Whether any job failed.

    Returns:
        1 after a limit violation, else 4 after a failure, else 0.
    """
    return command.VIOLATION if left_limits else command.INCOMPLETE if failed else 0
