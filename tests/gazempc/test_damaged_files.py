"""Damaged files of every kind: each is read, or refused by name within bounds. Nothing else happens."""

import time
from collections import Counter

import numpy as np
import pytest
from builders.damage import COSTLY, damaged, rng_of, sound_files

from gazempc.errors import GazempcError
from gazempc.recordings.readers.checks import MOST_DURATION_S, MOST_EXTENT_M
from gazempc.recordings.recording import Recording

INPUTS = 600
# A refusal is to come within 2 s; nothing here is so large that it takes a tenth of it.
MOST_S = 2.0
MOST_CHARACTERS = 3000


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return sound_files(tmp_path_factory.mktemp("sound"))


@pytest.mark.slow
def test_the_undamaged_files_are_read(files):
    for _, read in files.values():
        read()


@pytest.mark.slow
def test_damaged_files_are_read_or_refused_by_name(files):
    rng, became, slow = rng_of(20), Counter(), []
    names = [*5 * [name for name in files if name not in COSTLY], *COSTLY]
    # Of a recording that is a folder the message names the folder.
    folders = {name: str(path.parent) for name, (path, _) in files.items()}
    for k in range(INPUTS):
        name = names[k % len(names)]
        path, read = files[name]
        sound = path.read_bytes()
        replace(path, damaged(sound, rng))
        started_s = time.process_time()
        try:
            became[outcome(read, folders[name])] += 1
        except Exception as error:
            error.add_note(f"{name}, input {k}")
            raise
        finally:
            replace(path, sound)
        if time.process_time() - started_s > MOST_S:
            slow.append((name, k))
    assert slow == []
    assert became["refused"] > 0.3 * INPUTS
    assert became["accepted"] > 0.1 * INPUTS


def replace(path, content):
    """A new file of the same name: some file systems wait for the disk where an old one is written over."""
    path.unlink()
    path.write_bytes(content)


def outcome(read, folder):
    """What becomes of a file; a refusal names it in a few lines, and what is accepted can be."""
    try:
        result = read()
    except GazempcError as error:
        refusal = str(error)
    else:
        if isinstance(result, Recording):
            assert_plausible(result)
        return "accepted"
    assert folder in refusal
    assert len(refusal) < MOST_CHARACTERS
    return "refused"


def assert_plausible(recording):
    seen = recording.truth.valid
    assert np.ptp(recording.times_s[seen]) <= MOST_DURATION_S
    heads_m = recording.truth.head_position_m[seen]
    assert np.isfinite(heads_m).all()
    assert np.linalg.norm(heads_m - np.median(heads_m, axis=0), axis=1).max() <= MOST_EXTENT_M
