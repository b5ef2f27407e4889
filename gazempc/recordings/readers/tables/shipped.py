"""The mappings that ship: which of them a table fits."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from itertools import product

from gazempc.errors import RecordingError
from gazempc.recordings.readers.tables.columns import Columns
from gazempc.recordings.readers.tables.frames import orientations
from gazempc.recordings.readers.tables.mapping import ColumnMapping, ShippedMapping
from gazempc.recordings.readers.tables.people import PERSON, people_in_header
from gazempc.recordings.readers.tables.raw_table import RawTable, is_number
from gazempc.recordings.readers.tables.times import seconds
from gazempc.recordings.readers.tables.values import in_metres
from gazempc.specfiles import load_spec, shipped_names

FOLDER = "recordings/readers/tables/mappings"
_FEW_ROWS = 20


@lru_cache(maxsize=1)
def shipped_mappings() -> dict[str, ShippedMapping]:
    """All mappings that ship, by name, in the order in which they are tried."""
    found = {name: load_spec(ShippedMapping, FOLDER, name) for name in shipped_names(FOLDER)}
    # Those that ask for more columns come first: a skeleton before a rigid body.
    return dict(sorted(found.items(), key=lambda item: -len(item[1].texts())))


def fitting_mapping(table: RawTable) -> tuple[str, ShippedMapping] | None:
    """The shipped mapping that a table fits, without the parts that the table has not.

    Args:
        table: The table.

    Returns:
        Its name and the mapping, or None.
    """
    for name, mapping in shipped_mappings().items():
        if table.layout in mapping.layout and _shape_fits(table, mapping) and (found := _present(table, mapping)):
            return name, found
    return None


def _shape_fits(table: RawTable, mapping: ShippedMapping) -> bool:
    """Whether a table without a header has as many columns, with numbers, whole numbers and words where they belong."""
    if mapping.columns is None:
        return True
    if len(table.names) != mapping.columns:
        return False
    for number, name in enumerate(table.names, 1):
        cells = table.texts(name)[:_FEW_ROWS]
        is_text = not all(is_number(cell) for cell in cells)
        if is_text != (number in mapping.words):
            return False
        if number in mapping.integers and any(float(cell.replace(",", ".")) % 1.0 for cell in cells):
            return False
    return True


def _present(table: RawTable, mapping: ShippedMapping) -> ShippedMapping | None:
    """The mapping without optional parts that are not in the table; None if a needed part is not."""
    given = mapping.texts()
    for head in given["head"].split("|"):
        names = people_in_header(table, head) if PERSON in head else [""]
        # Of several, each has the same columns.
        columns = Columns(table.first(_FEW_ROWS), (names or [""])[0])
        if names and _is_there(partial(in_metres, columns, head, "head")):
            break
    else:
        return None

    def first(key: str, read: Callable[[str], object]) -> str | None:
        return next((text for text in given[key].split("|") if _is_there(partial(read, text))), None)

    found: dict[str, str | None] = {"head": head}
    readers: dict[str, Callable[[str], object]] = {
        "t": partial(seconds, columns),
        "person": columns.one,
        "frame_id": columns.one,
        "pelvis": partial(in_metres, columns, what="pelvis"),
    }
    for part, way in product(("head", "pelvis"), ("q", "euler", "yaw", "forward", "left")):
        readers[f"{part}_{way}"] = partial(_orientations, columns, part, way)
    found |= {key: first(key, read) for key, read in readers.items() if key in given}
    needed = ("t", *(key for key in ("person", *mapping.needs) if key in given))
    return None if any(found[key] is None for key in needed) else mapping.model_copy(update=found)


def _orientations(columns: Columns, part: str, way: str, text: str) -> object:
    """Orientations by one value of a mapping; the axes do not matter for whether its columns are there."""
    return orientations(columns, ColumnMapping.model_validate({f"{part}_{way}": text}), part, "z-up")


def _is_there(read: Callable[[], object]) -> bool:
    """Whether columns are in the header; what is wrong with their cells is said when they are read."""
    try:
        read()
    except RecordingError as error:
        return error.where != "header"
    return True
