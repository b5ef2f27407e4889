"""Tuning: interrupted, it ends with the same trials."""

import contextlib
import sys

import pytest
from builders.replays import quick_neck
from builders.studies import rows_of, words

from experiments.engine.engine import Engine
from experiments.sweep.sweep import main
from gazempc.errors import MissingOptionalDependencyError

pytestmark = pytest.mark.usefixtures("in_this_process")

TUNED = {
    "name": "tuned",
    "recordings": ["subject01_R1"],
    "base": {"controller": "lookahead"},
    "vary": {
        "lookahead.smoothing_time_s": {"low": 0, "high": 0.3},
        "predictor": ["last_position", "constant_velocity"],
    },
    "design": "optuna",
    "n": 5,
}


@pytest.mark.slow
def test_resumed_tuning_gives_the_same_trials(tmp_path, monkeypatch):
    """Stopped in the second batch: one batch is complete, one is partial."""
    monkeypatch.setattr("experiments.sweep.sweep.BATCH", 3)
    pytest.importorskip("optuna", reason="optuna is not installed (extra tune)")
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    tuned = TUNED | {"base": TUNED["base"] | {"neck": quick_neck(tmp_path)}}
    assert main(words(whole, tuned)) == 0
    run, runs = Engine.run, stopped / "out" / "runs"

    def stop_at_the_second(engine, jobs):
        if any(runs.glob("*.npz")):
            run(engine, jobs[:1])
            raise KeyboardInterrupt
        return run(engine, jobs)

    with monkeypatch.context() as patch, contextlib.suppress(KeyboardInterrupt):
        patch.setattr(Engine, "run", stop_at_the_second)
        main(words(stopped, tuned))
    before = {path: path.stat().st_mtime_ns for path in runs.glob("*.npz")}
    assert len(before) == 4
    assert main(words(stopped, tuned)) == 0
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in before.items())
    rows = rows_of(whole / "out")
    assert len(rows) == TUNED["n"]
    assert rows == rows_of(stopped / "out")
    assert len({r["lookahead.smoothing_time_s"] for r in rows}) > 3


def test_a_missing_package_names_its_extra(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    assert main(words(tmp_path, TUNED)) == 2
    assert str(MissingOptionalDependencyError("Design optuna", "optuna", "tune")) in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
