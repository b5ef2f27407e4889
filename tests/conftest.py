"""Fixtures shared by test modules."""

import atexit
import fcntl
import gc
import os
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

# One numerical thread per process, set before NumPy is loaded: the matrices are small, and tests run in parallel
# processes, whose threads would compete.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
# JAX reads this when it is imported: its functions are compiled for a few short runs.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
# MuJoCo reads this when it is imported: pictures are rendered without a screen.
os.environ.setdefault("MUJOCO_GL", "egl")
# Matplotlib reads this when it is imported: figures are drawn without a screen.
os.environ["MPLBACKEND"] = "Agg"

import hypothesis
import pytest

pytest.register_assert_rewrite("builders")
# Independent of machine load: no deadlines, and deterministic examples.
hypothesis.settings.register_profile("gazempc", deadline=None, derandomize=True, max_examples=50)
hypothesis.settings.load_profile("gazempc")

# Frozen objects would be reported as leaked when the process ends.
atexit.register(gc.unfreeze)

ROOT = Path(__file__).resolve().parents[1]
WALKS = Path(os.environ.get("GAZEMPC_WALKS", ROOT.parent / "shared" / "walks"))
TRACKS = Path(os.environ.get("GAZEMPC_TRACKS", ROOT.parent / "shared" / "tracks"))
BAGS = Path(os.environ.get("GAZEMPC_BAGS", ROOT.parent / "shared" / "bags"))


@pytest.fixture(scope="session")
def walks_dir() -> Path:
    """Folder with the recordings of real people, which are not part of the project."""
    return _folder_or_skip("the real walks", WALKS, "GAZEMPC_WALKS")


@pytest.fixture(scope="session")
def tracks_dir() -> Path:
    """Folder with head tracks of other people, positions only, which are not part of the project."""
    return _folder_or_skip("the head tracks", TRACKS, "GAZEMPC_TRACKS")


@pytest.fixture(scope="session")
def bags_dir() -> Path:
    """Folder with ROS 2 bags of a real face tracker, which are not part of the project."""
    return _folder_or_skip("the real bags", BAGS, "GAZEMPC_BAGS", "README.md")


@pytest.fixture(scope="module")
def in_this_process() -> Iterator[None]:
    """Commands of the module run jobs in process, which saves seconds; `tests/experiments/engine` tests workers."""
    from experiments.engine.job import carry_out, program_hash

    def do(jobs: dict[str, Any], count: int) -> Iterator[tuple[str, Any]]:
        # Pickled, as for a worker process.
        assert count >= 1
        for key, job in jobs.items():
            row = carry_out(pickle.loads(pickle.dumps(job)), key, program_hash())
            yield key, pickle.loads(pickle.dumps(row))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiments.engine.engine.on_this_machine", do)
        yield


@pytest.fixture
def real_time(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Holds a lock: two concurrent face detectors on rendered pictures would both miss their frame rate."""
    with (tmp_path_factory.getbasetemp().parent / "real_time.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _folder_or_skip(description: str, folder: Path, variable: str, marker: str = "index.csv") -> Path:
    if not (folder / marker).is_file():
        reason = f"{description} are not at {folder} (set {variable})"
        if os.environ.get("CI"):
            pytest.fail(f"{reason}, and CI must not skip this")
        pytest.skip(reason)
    return folder


def pytest_collection() -> None:
    """Disable garbage collection during imports, whose objects are permanent."""
    gc.disable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests with a lock come first: `--dist worksteal` starts them all in one worker, so none waits."""
    items.sort(key=lambda item: "real_time" not in getattr(item, "fixturenames", ()))


def pytest_collection_finish() -> None:
    """Freeze the objects of all imported test modules."""
    _freeze_permanent_objects()
    gc.enable()


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Freeze permanent objects after the last test of a module."""
    if nextitem is None or nextitem.path != item.path:
        _freeze_permanent_objects()


def _freeze_permanent_objects() -> None:
    """Exclude imported and cached objects from later garbage collections, to save time."""
    gc.collect()
    gc.freeze()
