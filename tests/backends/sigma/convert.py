"""Converts and validates Sigma rules; run by the Python of `.venv-sigma`, which has pySigma's backends.

Reads a JSON object of texts by name. Writes for each text its conversion by each target, `[query,
None]` or `[None, message]`, and the issues of validators.
"""

import json
import sys
from importlib import import_module
from typing import Any

from sigma.collection import SigmaCollection
from sigma.plugins import InstalledSigmaPlugins
from sigma.validation import SigmaValidator

TARGETS = {
    "splunk": ("splunk", "SplunkBackend"),
    "eql": ("elasticsearch", "EqlBackend"),
    "esql": ("elasticsearch", "ESQLBackend"),
    "lucene": ("elasticsearch", "LuceneBackend"),
    "kusto": ("kusto", "KustoBackend"),
    "loki": ("loki", "LogQLBackend"),
    "opensearch": ("opensearch", "OpensearchLuceneBackend"),
    "ppl": ("opensearch", "OpenSearchPPLBackend"),
    "sqlite": ("sqlite", "sqliteBackend"),
}


def converted(text: str, module: str, name: str) -> list[str | None]:
    """The queries of one target, or why there are none."""
    try:
        backend = getattr(import_module(f"sigma.backends.{module}"), name)()
        return ["\n".join(map(str, backend.convert(SigmaCollection.from_yaml(text)))), None]
    except Exception as error:  # noqa: BLE001 -- each backend raises its own errors
        return [None, f"{type(error).__name__}: {' '.join(str(error).split())}"]


def issues(text: str, excluded: set[str]) -> list[str]:
    """What the validators find, without those excluded."""
    known: Any = InstalledSigmaPlugins.autodiscover().validators
    validator: Any = SigmaValidator([one for name, one in known.items() if name not in excluded])
    return [str(one) for one in validator.validate_rules(SigmaCollection.from_yaml(text).rules)]


if __name__ == "__main__":
    texts, excluded = json.load(sys.stdin)
    found = {
        name: [{target: converted(text, *names) for target, names in TARGETS.items()}, issues(text, set(excluded))]
        for name, text in texts.items()
    }
    json.dump(found, sys.stdout)
