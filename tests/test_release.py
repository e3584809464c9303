"""What a release needs: one version everywhere, pages that are of its code, and public names in the manual."""

from __future__ import annotations

import json
import re
import sys
import tomllib
from pathlib import Path

from packaging.version import Version

import insnav
from insnav.cli import COMMANDS

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "reports"))

import release  # noqa: E402


def test_the_version_is_in_one_place() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert "version" in project["project"]["dynamic"]
    assert project["tool"]["hatch"]["version"]["path"] == "insnav/version.py"
    assert f"\nversion: {insnav.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_the_version_follows_the_changelog() -> None:
    """Changes after the newest release belong to a development version of a later one (PEP 440)."""
    text, own = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), Version(insnav.__version__)
    unreleased, newest = re.split(r"^## \[([\d.]+)\]", text, maxsplit=1, flags=re.MULTILINE)[:2]
    if re.search(r"^- ", unreleased, re.MULTILINE):
        assert own.is_devrelease
        assert Version(own.base_version) > Version(newest)
    else:
        assert own == Version(newest)


def test_pages_older_than_the_code_are_refused(tmp_path: Path) -> None:
    for name in (*release.PAGES, "insnav/a.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    record = tmp_path / "release.json"
    assert release.stale(tmp_path, record, ["insnav/a.py"]) == list(release.PAGES)  # never made
    pages = {page: release.digest(tmp_path, [page]) for page in release.PAGES}
    record.write_text(json.dumps({"sources": release.digest(tmp_path, ["insnav/a.py"]), "pages": pages}))
    assert release.stale(tmp_path, record, ["insnav/a.py"]) == []
    (tmp_path / release.PAGES[0]).write_text("by hand")
    assert release.stale(tmp_path, record, ["insnav/a.py"]) == [release.PAGES[0]]
    (tmp_path / "insnav/a.py").write_text("changed")
    assert release.stale(tmp_path, record, ["insnav/a.py"]) == list(release.PAGES)


def test_the_sources_are_those_of_the_package() -> None:
    assert {"insnav/version.py", "insnav/messages/en.toml", "trajectories/corpus.toml"} <= set(release.sources())


def test_every_public_name_and_command_is_in_the_manual() -> None:
    manual = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    documented = set(re.findall(r"^\.\. auto\w+:: (?:\w+\.)*(\w+)", manual, re.MULTILINE))
    assert sorted(set(insnav.__all__) - documented) == []
    for page in ("README.md", "README.zh-CN.md"):
        table = (ROOT / page).read_text(encoding="utf-8")
        assert [name for name in (*COMMANDS, "calibrate") if f"`{name}" not in table] == []
