"""Files of fitted numbers: saved and read, refused by name, one a person left out, and what the shipped one says."""

import json

import numpy as np
import pytest
from builders.walkers import random_model

from gazempc.errors import SettingsError
from gazempc.loop.build import Person, make_predictor
from gazempc.settings import WalkerSettings
from gazempc.sim.replay import ReplaySettings
from predictors.walker.model_file import load_walker_model, model_file, save_walker_model
from predictors.walker.network import WalkerModelError


def test_a_saved_model_is_the_same(tmp_path):
    model = random_model(degrees_of_freedom=3.5)
    save_walker_model(model, tmp_path / "m.npz")
    again = load_walker_model(tmp_path / "m.npz")
    assert again.about == model.about
    for name in ("weights", "biases", "blind_weights", "blind_biases"):
        pairs = zip(getattr(model, name), getattr(again, name), strict=True)
        assert all(np.array_equal(a, b) for a, b in pairs)
    for name in ("log_spread", "hidden", "log_spread_hidden", "noise_share"):
        np.testing.assert_array_equal(getattr(again, name), getattr(model, name))
    assert again.degrees_of_freedom == 3.5


def test_the_shipped_numbers_say_where_they_are_from():
    model = load_walker_model()
    about = model.about
    assert len(about["people"]) == 19  # four of them are trials of people who stand
    assert len(about["recordings"]) == 77
    assert "experiments.fit" in about["command"]
    assert "/" not in json.dumps(about["command"])


@pytest.mark.parametrize("content", [b"", b"no archive", None, "degrees_of_freedom", "hidden", "blind_weights_0"])
def test_a_wrong_file_is_named(tmp_path, content):
    path = tmp_path / "walker.npz"
    if content is None:
        np.savez(path, something=np.zeros(3))
    elif isinstance(content, str):  # as before this was fitted
        save_walker_model(random_model(), path)
        with np.load(path) as data:
            np.savez(path, **{k: v for k, v in data.items() if k != content})
    else:
        path.write_bytes(content)
    with pytest.raises(WalkerModelError, match=r"walker\.npz"):
        load_walker_model(path)
    with pytest.raises(SettingsError, match=r"walker\.fitted.*walker\.npz"):
        make_predictor("walker", ReplaySettings(walker=WalkerSettings(fitted=path)), Person(), {})


def test_a_folder_gives_the_model_that_has_not_seen_the_person(tmp_path):
    (tmp_path / "left_out").mkdir()
    for name in ("walker.npz", "left_out/ann.npz"):
        save_walker_model(random_model(), tmp_path / name)
    assert model_file(tmp_path, "ann") == tmp_path / "left_out" / "ann.npz"
    assert model_file(tmp_path, "bob") == tmp_path / "walker.npz"
    assert model_file(tmp_path / "walker.npz", "ann") == tmp_path / "walker.npz"
    with pytest.raises(WalkerModelError, match=r"experiments\.fit"):
        model_file(tmp_path / "left_out", "bob")
