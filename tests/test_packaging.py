"""Packaging: the lock file has every requirement in one version; the extra `all` has all extras."""

import re
import tomllib
from importlib.metadata import requires
from pathlib import Path

from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "requirements.lock").read_text(encoding="utf-8")


def locked():
    """Locked versions by name, for this platform."""
    found = {}
    for entry in re.split(r"\n(?=\w)", "\n".join(line for line in TEXT.splitlines() if not line.startswith("#"))):
        requirement, *hashes = entry.replace("\\\n", " ").split("--hash=")
        assert hashes, f"{requirement}: no hash"
        assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", each.strip()) for each in hashes), requirement
        stated = Requirement(requirement.strip())
        (version,) = stated.specifier
        assert version.operator == "==", requirement
        if stated.marker is None or stated.marker.evaluate():
            assert canonicalize_name(stated.name) not in found, f"{stated.name} stands there twice"
            found[canonicalize_name(stated.name)] = version.version
    return found


def test_the_lock_file_satisfies_all_requirements():
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    found, waiting, seen = locked(), [Requirement(text) for text in pyproject["project"]["dependencies"]], set()
    while waiting:
        required = waiting.pop()
        name = canonicalize_name(required.name)
        assert name in found, f"{name} is not in requirements.lock: make it anew, see its first lines"
        assert required.specifier.contains(found[name]), f"{required}, but requirements.lock has {found[name]}"
        key = (name, frozenset(required.extras))
        if key in seen:
            continue
        seen.add(key)
        # Requirements of other packages vary with their versions; the installed ones are close.
        for text in requires(name) or ():
            inner = Requirement(text)
            environments = [default_environment() | {"extra": extra} for extra in ("", *required.extras)]
            if inner.marker is None or any(inner.marker.evaluate(environment) for environment in environments):
                waiting.append(Requirement(inner.name))


FOR_DEVELOPERS = {"test", "dev", "docs"}


def test_the_extra_all_includes_every_user_extra():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    (everything,) = map(Requirement, extras["all"])
    assert everything.name == "gazempc"
    assert everything.extras == set(extras) - FOR_DEVELOPERS - {"all"}
