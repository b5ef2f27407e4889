"""The command `gazempc`."""

import importlib
from pathlib import Path

import pytest
from builders.own_parts import own_module

from experiments.console import COMMANDS, main


@pytest.mark.parametrize("words", [["--help"], ["-h"], []])
def test_the_command_lists_its_subcommands(words, capsys):
    assert main(words) == (0 if words else 2)
    output = capsys.readouterr().out
    for name, (_, what) in COMMANDS.items():
        assert f"  {name:<9} {what}" in output


def test_a_misspelt_command_is_named(capsys):
    assert main(["comprae"]) == 2
    assert "no command 'comprae': perhaps you meant 'compare'" in capsys.readouterr().err


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_has_help(name, capsys):
    assert callable(importlib.import_module(COMMANDS[name][0]).main)
    with pytest.raises(SystemExit) as ended:
        main([name, "--help"])
    assert ended.value.code == 0
    assert "--" in capsys.readouterr().out


ONE = "--recordings subject01_R4"


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("compare --recordings nowhere", "nowhere"),
        (f"compare {ONE} --necks x", "'x'"),
        (f"compare {ONE} --controllers my_parts:Slugish", "'Sluggish'"),
        (f"compare {ONE} --controllers no_parts:Sluggish", "'no_parts'"),
        (f"compare {ONE} --controllers mpc --options.share 1", "options"),
        ("sweep paretto", "'pareto'"),
        (f"fit {ONE} subject01_R1", "at least 2"),
        ("paper --recordings nowhere", "nowhere"),
        ("rivals --rivals humotin", "humotin"),
        ("rivals --trials walk", "walk"),
        ("rivals --walker.fitted no_folder", "no_folder"),
    ],
)
def test_bad_input_is_refused_before_any_run(words, named, tmp_path, monkeypatch, capsys):
    own_module(tmp_path, monkeypatch)
    assert main([*words.split(), "--out", "out"]) == 2
    assert named in capsys.readouterr().err
    assert not Path("out").exists()
