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

ROOT: Final = Path(__file__).parents[1]
ASSETS: Final = ROOT / "out" / "playground"
PYODIDE: Final = "pyodide@314.0.7"
NEEDED: Final = ("pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm", "python_stdlib.zip", "pyodide-lock.json")
LIBRARIES: Final = ("lark>=1.1.9", "networkx>=3.2", "click>=8.1")
"""What translation and the engine import; other libraries of rvaft are imported only for files and tools."""


def main() -> None:
    """Fetch everything, or end with the reason."""
    npm = shutil.which("npm")
    if npm is None:
        sys.exit("the playground needs npm, which brings Pyodide: apt-get install npm")
    ASSETS.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([npm, "pack", PYODIDE, "--silent"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        (archive,) = Path(folder).glob("*.tgz")
        with tarfile.open(archive) as packed:
            packed.extractall(folder, filter="data")
        for name in NEEDED:
            shutil.copy(Path(folder) / "package" / name, ASSETS / name)
    for old in ASSETS.glob("*.whl"):
        old.unlink()
    pip = [sys.executable, "-m", "pip", "--quiet"]
    subprocess.run([*pip, "download", "--no-deps", "--dest", str(ASSETS), *LIBRARIES], check=True)
    subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", str(ASSETS), str(ROOT)], check=True)
    names = sorted(file.name for file in ASSETS.glob("*.whl"))
    (ASSETS / "wheels.json").write_text(f"{json.dumps(names)}\n")


if __name__ == "__main__":
    main()
