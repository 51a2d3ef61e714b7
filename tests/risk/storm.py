"""Solves a Galileo file with Storm, in a process of its own: P(1), least and greatest, and the mean time, as JSON.

python storm.py FILE
"""

import importlib
import json
import sys


def main() -> None:
    """Solve the file and print what is known, after each number."""
    stormpy, dft = (importlib.import_module(name) for name in ("stormpy", "stormpy.dft"))
    tree = dft.prepare_for_analysis(dft.load_dft_galileo_file(sys.argv[1]))
    found: list[float] = []
    for formula in ('Pmin=? [F<=1 "failed"]', 'Pmax=? [F<=1 "failed"]', 'Tmin=? [F "failed"]'):
        found += dft.analyze_dft(tree, stormpy.parse_properties(formula)[0])
        sys.stdout.write(json.dumps(found) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
