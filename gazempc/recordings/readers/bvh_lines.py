"""Lines and numbers of BVH text, with the line's number in every error; lines are counted from 1."""

from __future__ import annotations

from pathlib import Path

from gazempc.errors import RecordingError, shown


class Lines:
    """The file's lines that are not blank, split into words, read one after the other."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        split = ((number, line.split()) for number, line in enumerate(text.splitlines(), start=1))
        self._lines = [(number, words) for number, words in split if words]
        self._next = 0
        self.number = 0

    def next(self, expected: str) -> list[str]:
        """Words of the next line.

        Raises:
            RecordingError: If the file ends instead.
        """
        if self._next == len(self._lines):
            last = self._lines[-1][0]
            raise RecordingError(self.path, f"line {last}", "the file ends here (cut off?)", expected)
        self.number, words = self._lines[self._next]
        self._next += 1
        return words

    def push_back(self, words: list[str]) -> None:
        """Hand in words of the current line that the next call shall return."""
        self._next -= 1
        self._lines[self._next] = (self.number, words)

    def rest(self) -> list[tuple[int, list[str]]]:
        """All lines not yet read, with their numbers."""
        return self._lines[self._next :]

    def error(self, problem: str, expected: str) -> RecordingError:
        """An error in the current line."""
        return RecordingError(self.path, f"line {self.number}", problem, expected)


def parse_number(path: Path, line: int, word: str) -> float:
    """Parse a number of a line.

    Raises:
        RecordingError: If it is not one; shows what stands there.
    """
    try:
        return float(word)
    except ValueError:
        raise RecordingError(path, f"line {line}", f"{shown(word)} is not a number", "a number") from None
