"""Tables generated from the code: every setting, event and public name, with its meaning."""

import pytest
from builders.pages import DOCS, page
from pydantic import BaseModel, Field

import gazempc
from gazempc.live.settings import LiveSettings
from gazempc.loop.events import Event
from gazempc.run_settings import RunSettings

pytest.importorskip("sphinx", reason="sphinx is not installed (extra docs)")


@pytest.fixture
def extension(monkeypatch):
    monkeypatch.syspath_prepend(DOCS / "extensions")
    import generated_tables

    return generated_tables


class Inner(BaseModel):
    gain: float = Field(default=0.5, description="Of a|b, see --gain")


class Outer(BaseModel):
    name: str = Field(description="Name")
    inner: Inner = Inner()
    perhaps: Inner | None = Field(default=None, description="Table")
    ids: tuple[int, ...] = (1, 2)
    on: bool = False


class Other(BaseModel):
    inner: Inner = Inner()
    on: bool = True


def rows(extension, *models):
    return [line for line in extension.markdown(*models) if line.startswith("| `")]


def test_tables_show_nested_settings_defaults_and_escapes(extension):
    assert rows(extension, Outer) == [
        "| `name` |  | Name |",
        "| `ids` | `1, 2` |  |",
        "| `on` | no |  |",
        "| `inner.gain` | `0.5` | Of a\\|b, see `--gain` |",
        "| `perhaps.gain` | `0.5` | Of a\\|b, see `--gain` |",
    ]


def test_fields_of_another_model_can_be_omitted(extension):
    assert [row.split("`")[1] for row in rows(extension, Outer, Other)] == ["name", "ids", "perhaps.gain"]


def leaves(values, prefix=""):
    """Dotted names of a dump of settings."""
    for name, value in values.items():
        if isinstance(value, dict) and value:
            yield from leaves(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}"


def expanded(extension, name):
    """Last cells of the tables of a page, by the code in the first cell."""
    source = [page(name)]
    extension.expand(None, name, source)
    return {row.split("`")[1]: row.split(" | ")[-1] for row in source[0].splitlines() if row.startswith("| `")}


def test_every_event_is_on_the_safety_page(extension):
    assert {event.value for event in Event} - set(expanded(extension, "safety")) == set()


def test_every_public_name_links_to_its_description(extension):
    found = expanded(extension, "api")
    assert set(found) == {f"gz.{name}" for name in gazempc.__all__}
    assert found["gz.replay"] == "{py:func}`gazempc.front.replay` |"
    assert found["gz.Mpc"] == "{py:class}`gazempc.controllers.mpc.mpc.Mpc` |"


@pytest.mark.parametrize("settings", [RunSettings(), LiveSettings(source="replay")], ids=["run", "live"])
def test_every_setting_is_on_the_page_with_a_meaning(extension, settings):
    meanings = expanded(extension, "settings")
    names = set(leaves(settings.model_dump()))
    assert names - set(meanings) == set()
    assert [name for name in names if len(meanings[name]) < 6] == []
