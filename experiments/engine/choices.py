"""Recordings, sensors and own parts of a command line, and the settings that name them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from pydantic import Field

from experiments.engine.command import WorkSettings
from experiments.engine.job import Row
from gazempc.errors import GazempcError, SettingsError, shown, suggest
from gazempc.loop.build import walker_model
from gazempc.part_options import check_options, options_for
from gazempc.parts import CONTROLLER, PREDICTOR, find, is_own
from gazempc.recordings.load import ENDINGS_IN_FOLDERS, is_recording, is_recording_folder
from gazempc.recordings.synthetic.everyday import everyday_names
from gazempc.recordings.synthetic.walks import synthetic_names
from gazempc.settings import DEFAULT_PREDICTOR, PredictorChoice, WalkerSettings
from gazempc.sim.sensor import SensorSpec, load_sensor

# Sensors that a recording may call for if none is named.
_DEFAULT_SENSORS = ("reference", "recorded")
_SETS = {"synthetic": synthetic_names, "everyday": everyday_names}


class ChoiceSettings(WorkSettings):
    """Settings of a comparison over recordings."""

    recordings: tuple[str, ...] = Field(
        min_length=1, description="'synthetic' (14 x 6), 'everyday' (14 x 5), folders, files or synthetic names"
    )
    predictors: tuple[PredictorChoice | Literal["default"], ...] = Field(
        default=("default",), min_length=1, description="Forecasts; default is the run command's; module:Class"
    )
    sensors: tuple[str, ...] = Field(
        default=(), description="Shipped sensors or .toml files; without them what fits each recording"
    )
    walker: WalkerSettings = WalkerSettings()
    options: Annotated[dict[str, Any], tyro.conf.Suppress] = Field(
        default={}, description="Options of parts of your own: --options.KEY VALUE, for a parameter of the constructor"
    )

    def checked_predictors(self, *controllers: str) -> list[str]:
        """The predictors by name, each once.

        Args:
            controllers: That use them.

        Raises:
            GazempcError: If a part or a fitted model is missing, or an option is for none.
        """
        predictors = list(dict.fromkeys(DEFAULT_PREDICTOR if p == "default" else p for p in self.predictors))
        check_parts(controllers, predictors, self.options)
        check_fitted(self.walker)
        return predictors


def check_fitted(walker: WalkerSettings) -> None:
    """Raise WalkerModelError unless the fitted models can be read."""
    if walker.fitted is not None:
        walker_model(walker.fitted, "")


def find_recordings(words: Sequence[str]) -> list[str]:
    """Names and paths of recordings.

    Args:
        words: ``synthetic`` for all synthetic walks, ``everyday`` for the synthetic people who stand, start and stop, a
            folder for all recordings in it (its ``index.csv`` is not one), a file, a folder that is itself a
            recording, or a synthetic name.

    Returns:
        Names and paths, each once, in the order given; files of a folder sorted.

    Raises:
        GazempcError: If something does not exist, or a folder has no recordings; all such words at once.
    """
    found: list[str] = []
    problems = []
    for word in words:
        path = Path(word)
        try:
            path.exists()
        except (OSError, ValueError) as error:  # such as a name longer than the system allows, or with a zero in it
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


def in_place(recording: str) -> str:
    """A recording by a name that is right in any folder: the absolute path of a file, or a synthetic name."""
    path = Path(recording)
    return str(path.resolve()) if path.exists() else recording


def sensors_by_name(chosen: str | None) -> dict[str, SensorSpec]:
    """The chosen sensor, or all that a recording may call for.

    Args:
        chosen: Shipped sensor or .toml file; None for the one that fits each recording.

    Returns:
        Sensor by name.

    Raises:
        SettingsError: If there is no such sensor.
    """
    return {name: load_sensor(name) for name in ((chosen,) if chosen else _DEFAULT_SENSORS)}


def each_sensor(chosen: Sequence[str]) -> dict[str | None, dict[str, SensorSpec]]:
    """The sensors of a comparison.

    Args:
        chosen: Shipped sensors or .toml files; none for the one that fits each recording.

    Returns:
        What `sensors_by_name` gives for each; under None if none was chosen.

    Raises:
        SettingsError: If there is no such sensor, or two have the same name, which tables could not tell apart.
    """
    found = {name: sensors_by_name(name) for name in dict.fromkeys(chosen or (None,))}
    first: dict[str, str] = {}
    for word, sensor in ((word, sensors[word]) for word, sensors in found.items() if word is not None):
        if first.setdefault(sensor.name, word) != word:
            raise SettingsError(f"sensors {first[sensor.name]} and {word} have the same name, {sensor.name!r}")
    return found


def check_parts(controllers: Iterable[str], predictors: Iterable[str], options: Mapping[str, Any]) -> None:
    """Check before anything runs that parts of the user's own can be imported, and that each option is for one.

    Args:
        controllers: Shipped names, or ``module:Class``.
        predictors: The same.
        options: Values by parameter, see `gazempc.part_options.options_for`.

    Raises:
        SettingsError: If not.
    """
    parts = [*((CONTROLLER, choice) for choice in controllers), *((PREDICTOR, choice) for choice in predictors)]
    for kind, choice in parts:
        if is_own(choice):
            find(kind, choice)
    check_options(parts, options)


def options_of(controller: str, predictor: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """The options that are for one of two parts: no other option makes it another run.

    Args:
        controller: A shipped name, or ``module:Class``.
        predictor: The same.
        options: Options of all parts.

    Returns:
        Values by ``kind.parameter``.
    """
    return {
        f"{kind.name}.{name}": value
        for kind, choice in ((CONTROLLER, controller), (PREDICTOR, predictor))
        for name, value in options_for(kind, choice, options).items()
    }


def name_parts(rows: Iterable[Row], part: str) -> None:
    """Put the names that parts have into rows, in place of ``module:Class``.

    Two parts of the same name keep ``module:Class``, to be distinct.

    Args:
        rows: Rows with a choice under `part` if it matters, and the part's name under ``<part>_name`` if the run is
            done; the latter is taken out.
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
