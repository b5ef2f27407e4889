"""A log as an MCAP file: channels that viewers show, and the whole log, exact to the last bit, as an attachment.

Written with foxglove-sdk, read with the `mcap` library; both are in the extra ``view``.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from gazempc.errors import SettingsError
from gazempc.files.whole import whole
from gazempc.results.log import Log
from gazempc.results.log_moments import moments_of
from gazempc.results.mcap_read import NEEDS_VIEW
from gazempc.results.moments import PlanMoment


def write_mcap(log: Log, path: Path | str, plans: Sequence[PlanMoment] = ()) -> None:
    """Write a log as MCAP.

    The channels are those of `gazempc.results.mcap_channels.Channels`. A log has neither plans, lateness nor pictures.

    Args:
        log: The log.
        path: File to write; an old one is replaced.
        plans: The plans of the run, where they were kept.

    Raises:
        SettingsError: If a package is missing or the file cannot be written.
    """
    try:
        from gazempc.results.mcap_channels import Channels  # noqa: PLC0415  (optional packages)
        from gazempc.results.mcap_writer import McapWriter  # noqa: PLC0415
    except ImportError:
        raise SettingsError(NEEDS_VIEW) from None
    buffer = io.BytesIO()
    log.save(buffer)
    with whole(Path(path)) as part, McapWriter(log.run, part) as writer:
        channels = Channels(log.run, writer.context)
        for moment in moments_of(log, plans):
            channels.write(moment)
        writer.attach(buffer.getvalue())
