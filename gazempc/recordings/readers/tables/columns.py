"""Finds the columns that a mapping names."""

from __future__ import annotations

import re
from collections.abc import Sequence

from gazempc.errors import RecordingError, shown, suggest
from gazempc.recordings.readers.tables.raw_table import RawTable, split_unit

# What stands between a group's name and the letter of a column.
_JOINTS = ("", ".", "_", " ", "/", "-", ":", "__")
_NUMBER = re.compile(r"#(\d+)")


class Columns:
    """Finds columns of one table, for one person of those whose names are in its header.

    Args:
        table: The table.
        person: What stands for ``{person}`` in a mapping.
    """

    def __init__(self, table: RawTable, person: str = "") -> None:
        self.table = table
        self._person = person
        self._by_name: dict[str, str] = {}
        for name in reversed(table.names):
            self._by_name[split_unit(name)[0].casefold()] = name
        self._by_name |= {name.casefold(): name for name in reversed(table.names)}

    def one(self, text: str) -> str:
        """Name of the column that a value names.

        Raises:
            RecordingError: If there is none.
        """
        wanted = self._filled(text)
        number = _NUMBER.fullmatch(wanted)
        if number and 0 < int(number[1]) <= len(self.table.names):
            return self.table.names[int(number[1]) - 1]
        found = wanted if wanted in self.table.names else self._by_name.get(wanted.casefold())
        if found is None:
            raise self.missing(f"column {wanted!r}", wanted)
        return found

    def has(self, text: str) -> bool:
        """Whether there is such a column."""
        wanted = self._filled(text)
        return wanted in self.table.names or wanted.casefold() in self._by_name

    def group(self, text: str, alphabets: Sequence[Sequence[str]]) -> list[str] | None:
        """Columns of a group such as ``head`` for ``head_x``, ``head_y``, ``head_z``; None if they are not there."""
        base = self._filled(text).casefold()
        for letters in alphabets:
            for joint in _JOINTS:
                for wanted in ([f"{base}{joint}{c}" for c in letters], [f"{c}{joint}{base}" for c in letters]):
                    if all(name in self._by_name for name in wanted):
                        return [self._by_name[name] for name in wanted]
        return None

    def missing(self, what: str, wanted: str = "") -> RecordingError:
        """The error that columns are not there."""
        near = suggest(wanted, self.table.names).partition(";")[0] if wanted else ""
        hint = f" ({near})" if near.startswith("perhaps") else ""
        return RecordingError(
            self.table.path,
            "header",
            f"no {what}{hint}; found {shown(', '.join(self.table.names), 200)}",
            "columns of the file, as its header or, without one, their numbers name them",
        )

    def _filled(self, text: str) -> str:
        return text.replace("{person}:", f"{self._person}:" if self._person else "").replace("{person}", self._person)


def split_options(text: str, known: Sequence[str]) -> tuple[str, list[str]]:
    """Take units and orders off the end of a value.

    Args:
        text: Such as ``pose.position:mm``.
        known: Words that may stand there.

    Returns:
        The rest, and the words.
    """
    words: list[str] = []
    while ":" in text:
        rest, _, word = text.rpartition(":")
        if word.strip() not in known:
            break
        words.insert(0, word.strip())
        text = rest
    return text.strip(), words


def listed(text: str) -> list[str] | None:
    """Elements of ``[a, b, c]``; None if the text is no list."""
    if text[:1] in "[(" and text[-1:] in "])":
        return [part.strip() for part in text[1:-1].split(",")]
    return None
