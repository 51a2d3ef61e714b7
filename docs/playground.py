"""Fetch what the playground page needs into `out/playground`: Pyodide from npm, and wheels of rvaft and its libraries.

`make playground` runs this script before the site is built. The page itself fetches nothing from
another host.
"""

import json
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Final
from zipfile import ZIP_DEFLATED, ZipFile

import yaml

ROOT: Final = Path(__file__).parents[1]
ASSETS: Final = ROOT / "out" / "playground"
PYODIDE: Final = "pyodide@314.0.7"
NEEDED: Final = ("pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm", "python_stdlib.zip", "pyodide-lock.json")
LIBRARIES: Final = ("lark>=1.1.9", "networkx>=3.2", "click>=8.1", "tzdata")
"""What translation and the engine import; other libraries of rvaft are imported only for files and tools."""


YAML: Final = "pyyaml.whl"
"""The part of PyYAML that is Python alone, which Sigma rules need."""


def main() -> None:
    """Fetch everything, or end with the reason; with `--try`, say it and go on without a playground."""
    trying = "--try" in sys.argv
    try:
        fetch(keep=trying)
    except (OSError, subprocess.SubprocessError) as error:
        shutil.rmtree(ASSETS, ignore_errors=True)
        reason = f"the playground is not built: {error}"
        sys.exit(reason) if not trying else print(reason)


def fetch(*, keep: bool) -> None:
    """Fetch Pyodide, unless it is there and to be kept, and make the wheels; raises `OSError` and `SubprocessError`."""
    ASSETS.mkdir(parents=True, exist_ok=True)
    known = ASSETS / "version.txt"
    if not (keep and known.exists() and known.read_text() == PYODIDE):
        fetch_pyodide()
        known.write_text(PYODIDE)
    pip = [sys.executable, "-m", "pip", "--quiet"]
    for old in ASSETS.glob("*.whl"):
        old.unlink()
    subprocess.run([*pip, "download", "--no-deps", "--dest", str(ASSETS), *LIBRARIES], check=True)
    subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", str(ASSETS), str(ROOT)], check=True)
    with ZipFile(ASSETS / YAML, "w", ZIP_DEFLATED) as packed:
        for file in sorted(Path(yaml.__file__).parent.glob("*.py")):
            packed.write(file, f"yaml/{file.name}")
    names = sorted(file.name for file in ASSETS.glob("*.whl"))
    (ASSETS / "wheels.json").write_text(f"{json.dumps(names)}\n")


def fetch_pyodide() -> None:
    """Fetch Pyodide and the libraries of Python; raises `OSError` without npm, and `SubprocessError`."""
    npm = shutil.which("npm")
    if npm is None:
        raise FileNotFoundError("it needs npm, which brings Pyodide: apt-get install npm")
    with tempfile.TemporaryDirectory() as folder:
        command = [npm, "pack", PYODIDE, "--silent"]
        subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL, timeout=120)
        (archive,) = Path(folder).glob("*.tgz")
        with tarfile.open(archive) as packed:
            packed.extractall(folder, filter="data")
        for name in NEEDED:
            shutil.copy(Path(folder) / "package" / name, ASSETS / name)


if __name__ == "__main__":
    main()
