"""The package's own columns, in SI units, with z up."""

from __future__ import annotations

from gazempc.errors import RecordingError, shown
from gazempc.recordings.readers.tables.mapping import ColumnMapping
from gazempc.recordings.readers.tables.people import person_column
from gazempc.recordings.readers.tables.raw_table import RawTable

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
