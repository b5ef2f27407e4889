"""Several people in one table, by an id column or by names in the header; the package's own columns."""

from __future__ import annotations

import re
from collections import Counter

import numpy as np

from gazempc.errors import RecordingError, SettingsError, shown, suggest
from gazempc.recordings.readers.tables.mapping import ColumnMapping
from gazempc.recordings.readers.tables.raw_table import RawTable
from gazempc.recordings.readers.tables.values import LENGTHS_M, POSITION, split_options
from gazempc.types import BoolArray

PERSON = "{person}"
_HEADS = ("head", "face", "skull", "helmet", "glasses", "cap")
_SHOWN = 8
_COLUMN = re.compile(
    r"id|(person|people|track|ped|pedestrian|agent|subject|body|face|user|object|human|target)[ _.]?(id|name|no|nr)?",
    re.I,
)


def person_column(table: RawTable) -> str | None:
    """A column of ids: few values in many rows, and a name for people."""
    for name in table.names:
        if name and _COLUMN.fullmatch(name):
            values = table.texts(name)
            if len(set(values)) <= max(1, len(values) // 4):
                return name
    return None


def people_in_header(table: RawTable, head: str) -> list[str]:
    """Who or what has columns for the head.

    Args:
        table: The table.
        head: Value of the mapping, with ``{person}`` in it.

    Returns:
        Names, in the order of the columns; "" for columns without a name.
    """
    body, _ = split_options(head, tuple(LENGTHS_M))
    first = body if table_has(table, body) else re.split(r"[+-]", body)[0].strip()
    # A colon belongs to the name: without a name there is none.
    pattern = re.escape(first).replace(r"\{person\}:", "(?:(?P<person>.+):)?", 1)
    pattern = pattern.replace(r"\{person\}", "(?P<person>.+)" if "P<person>" not in pattern else "(?P=person)")
    expression = re.compile(rf"{pattern}[._ ]?{POSITION[0][0]}", re.IGNORECASE)
    found = [match["person"] or "" for name in table.names if (match := expression.fullmatch(name))]
    return list(dict.fromkeys(found))


def table_has(table: RawTable, text: str) -> bool:
    """Whether a value without its unit names a group of columns as a whole, with any person."""
    base = re.escape(text).replace(r"\{person\}", ".+")
    return any(re.fullmatch(rf"{base}[._ ]?[xX]", name) for name in table.names)


def choose_from_header(table: RawTable, names: list[str], wanted: str | None) -> tuple[str, list[str]]:
    """Whose columns are read.

    Args:
        table: The table.
        names: Who has columns.
        wanted: The user's choice, or None.

    Returns:
        The name, and a note if there are others.

    Raises:
        SettingsError: If the wanted one is not there.
        RecordingError: If there are several heads.
    """
    if wanted is not None:
        found = [name for name in names if name.casefold() == wanted.casefold()]
        if not found:
            raise SettingsError(f"--reading.person {wanted}: not in {table.path}; {suggest(wanted, names)}")
        return found[0], []
    if len(names) == 1:
        return names[0], []
    likely = [name for name in names if any(word in name.casefold() for word in _HEADS)]
    if len(likely) == 1:
        others = ", ".join(name for name in names if name != likely[0])
        return likely[0], [f"the head is {likely[0]!r}; also in the file: {others}; choose by --reading.person"]
    raise RecordingError(
        table.path,
        "header",
        f"several could be the person's head: {', '.join(likely or names)}",
        f"which one, such as --reading.person {(likely or names)[0]!r}",
    )


def rows_of_person(
    table: RawTable, column: str, known: BoolArray, wanted: str | None
) -> tuple[BoolArray, str, list[str]]:
    """Which rows are one person's.

    Args:
        table: The table.
        column: Column with the people's ids.
        known: Rows in which a head is seen, shape (N,).
        wanted: The user's choice, or None for the person with most rows.

    Returns:
        Rows, shape (N,); the id; and a note if there are others.

    Raises:
        SettingsError: If the wanted one is not there.
    """
    ids = np.array([_plain(text) for text in table.texts(column)])
    seen = Counter(dict.fromkeys(ids.tolist(), 0))
    seen.update(ids[known].tolist())
    if wanted is not None and _plain(wanted) not in seen:
        raise SettingsError(f"--reading.person {wanted}: not in {table.path}; {suggest(_plain(wanted), seen)}")
    chosen = _plain(wanted) if wanted is not None else seen.most_common(1)[0][0]
    note = []
    if len(seen) > 1:
        others = [f"{name} ({count})" for name, count in seen.most_common() if name != chosen]
        more = f" and {len(others) - _SHOWN} more" if len(others) > _SHOWN else ""
        why = "" if wanted is not None else ", the most"
        note.append(
            f"person {chosen} of {len(seen)} ({seen[chosen]} rows{why}); also in the file: "
            f"{', '.join(others[:_SHOWN])}{more}; choose by --reading.person"
        )
    return ids == chosen, chosen, note


def _plain(text: str) -> str:
    """An id as people write it: 3 for 3.0 and for 3.0e+00."""
    try:
        number = float(text)
        return str(int(number)) if number.is_integer() else text.strip()
    except (ValueError, OverflowError):
        return text.strip()


NEEDED = ("t", "head_x", "head_y", "head_z")
# Each of these is there with all of its columns, or not at all.
_OPTIONAL = {
    "head_q{w,x,y,z}": tuple(f"head_q{part}" for part in "wxyz"),
    "pelvis_{x,y,z}": tuple(f"pelvis_{axis}" for axis in "xyz"),
    "pelvis_q{w,x,y,z}": tuple(f"pelvis_q{part}" for part in "wxyz"),
}
COLUMNS = (*NEEDED, *(name for names in _OPTIONAL.values() for name in names))


def own_mapping(table: RawTable) -> ColumnMapping:
    """Mapping of the package's own columns.

    Raises:
        RecordingError: If an optional part is there in part.
    """
    begun = [names for names in _OPTIONAL.values() if any(name in table.names for name in names)]
    missing = [name for names in begun for name in names if name not in table.names]
    if missing:
        raise RecordingError(
            table.path,
            "header",
            f"missing column(s) {', '.join(missing)}; found {shown(', '.join(table.names), 200)}",
            f"the columns {', '.join(NEEDED)}, and with all of its columns or none, each of {', '.join(_OPTIONAL)}",
        )
    person = person_column(table)
    several = person is not None and len(set(table.texts(person))) > 1
    keys = {"head_q{w,x,y,z}": "head_q", "pelvis_{x,y,z}": "pelvis", "pelvis_q{w,x,y,z}": "pelvis_q"}
    optional = {keys[part]: keys[part] for part, names in _OPTIONAL.items() if names in begun}
    return ColumnMapping.model_validate(
        {"t": "t:s", "head": "head:m"} | optional | ({"person": person} if several else {})
    )
