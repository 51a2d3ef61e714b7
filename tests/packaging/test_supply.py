"""What is installed: versions and hashes of the lock file, licences, and actions pinned by commit."""

import importlib.metadata as installed
import importlib.util
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import pytest
import yaml
from packaging.requirements import Requirement

from tests.tables import rows

ROOT: Final = Path(__file__).parents[2]
PROJECT: Final = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
EXTRAS: Final[dict[str, list[str]]] = PROJECT["project"]["optional-dependencies"]
ACTION: Final[dict[str, Any]] = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
LICENCES: Final[dict[str, tuple[str, str]]] = {
    name: (licence, said) for name, licence, said in rows(__file__, "licences.txt")
}
LARGE: Final = ("dev", "flink")
"""What a user of rvaft does not install with it: tools of developers, and Apache Flink."""


def _locked() -> ModuleType:
    spec = importlib.util.spec_from_file_location("locked", ROOT / ".ci" / "locked.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


LOCKED: Final = _locked()


def packages(*extras: str) -> set[str]:
    """The packages that some extras bring, and those they need."""
    return {LOCKED.normal(line) for line in LOCKED.locked(extras or [""]) if not line.startswith(" ")}


def test_every_locked_package_has_a_version_and_hashes() -> None:
    for name, (lines, _) in LOCKED.entries().items():
        heads = [number for number, line in enumerate(lines) if not line.startswith(" ")]
        for start, end in zip(heads, [*heads[1:], len(lines)], strict=True):
            assert "==" in lines[start], name
            assert end - start > 1, name
            assert all(
                re.fullmatch(r"    --hash=sha256:[0-9a-f]{64}( \\)?", line) for line in lines[start + 1 : end]
            ), name


def test_the_lock_file_has_what_the_project_asks_for() -> None:
    every = LOCKED.entries()
    asked = [*PROJECT["project"]["dependencies"], *PROJECT["dependency-groups"]["build"]]
    for text in [*asked, *(one for name, some in EXTRAS.items() if name != "flink" for one in some)]:
        requirement = Requirement(text)
        versions = re.findall(r"==([^ ;\\]+)", "\n".join(every[LOCKED.normal(requirement.name)][0]))
        assert versions, text
        assert all(requirement.specifier.contains(one, prereleases=True) for one in versions), (text, versions)


def test_an_unknown_extra_is_refused() -> None:
    done = subprocess.run(
        [sys.executable, ROOT / ".ci" / "locked.py", "nothing"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "rvaft has no extra nothing" in done.stderr


def test_packages_have_a_licence_that_is_known() -> None:
    """A new package, or one that declares another licence than before, needs a row."""
    found = packages(*(name for name in EXTRAS if name not in LARGE))
    assert found == LICENCES.keys()


@pytest.mark.parametrize("name", LICENCES)
def test_a_package_declares_what_the_table_says(name: str) -> None:
    try:
        about = installed.metadata(name)
    except installed.PackageNotFoundError:
        pytest.skip(f"{name} is not installed")
    kinds = [one.rpartition(" :: ")[2] for one in about.get_all("Classifier") or [] if one.startswith("License")]
    first = next(iter(about.get_all("License") or [""])).strip().split("\n")[0][:60]
    declared = "".join(about.get_all("License-Expression") or []) or ", ".join(kinds) or first
    assert declared == LICENCES[name][1]


def test_the_licences_that_bind_most_are_extras() -> None:
    """EQL's library is under the AGPL: nobody gets it without asking for it."""
    assert [name for name, (licence, _) in LICENCES.items() if "AGPL" in licence] == ["eql"]
    assert "eql" not in packages()
    assert "eql" not in packages(*ACTION["inputs"]["extras"]["default"].split(","))
    assert LICENCES["spottl"][0] == "GPL-3.0-or-later"
    text = (ROOT / "docs" / "installation.md").read_text(encoding="utf-8")
    assert "AGPL" in text
    assert "spottl" in text


def test_actions_are_pinned_by_commit() -> None:
    used = [step["uses"] for step in ACTION["runs"]["steps"] if "uses" in step]
    assert used
    assert all(re.fullmatch(r"[\w./-]+@[0-9a-f]{40}", one) for one in used)


def test_what_ci_and_the_action_install_is_locked() -> None:
    (install,) = [step["run"] for step in ACTION["runs"]["steps"] if step.get("name") == "Install rvaft"]
    assert "--require-hashes" in install
    assert "export LOCKED=1" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    commands = [line for line in (ROOT / "Makefile").read_text(encoding="utf-8").split("\n") if "--no-deps" in line]
    assert any("--require-hashes" in line for line in commands)
