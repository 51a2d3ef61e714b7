"""The reference of the command line, from the parser of each command, with an example for each option."""

from collections.abc import Iterator
from typing import Final

import click

from rvaft.cli import loaded, main

CALLS: Final = {
    "check": "tree.rvaft",
    "show": "tree.rvaft",
    "branches": "tree.rvaft",
    "emit": "tree.rvaft --to sql",
    "build": "tree.rvaft -o monitor",
    "test": "tree.rvaft",
    "monitor": "tree.rvaft log.jsonl",
    "report": "tree.rvaft log.jsonl -o report.html",
    "view": "tree.rvaft log.jsonl",
    "coverage": "tree.rvaft log.jsonl",
    "robust": "tree.rvaft log.jsonl",
    "traces": "tree.rvaft",
    "serve": "tree.rvaft",
    "rosmonitoring": "tree.rvaft -o config",
    "cross-check": "tree.rvaft",
    "compare": "tree.rvaft",
    "backends": "",
    "explain": "unbound-variable",
    "fields": "log.jsonl",
    "infer": "log.jsonl",
    "lsp": "",
    "cut-sets": "tree.rvaft",
    "risk": "tree.rvaft --time '100 h'",
    "attacks": "tree.rvaft",
    "rates": "tree.rvaft log.jsonl",
}
"""The arguments of each command in the examples."""

_VALUES: Final = {
    "--action": "log",
    "--against": "rule.eql",
    "--backend": "rml",
    "--backends": "rml,ltlf",
    "--branch": "2",
    "--by": "eventName",
    "--capacity": "1000",
    "--curve": "20",
    "--list": "front",
    "--max-order": "4",
    "--prune-below": "1e-9",
    "--risk": "'1 h'",
    "--risk-above": "0.01",
    "--simulate": "10000",
    "--without": "leak",
    "--checkpoint": "state.ckpt",
    "--checkpoint-every": "1000",
    "--columns": "user=user_name",
    "--collapse": "login",
    "--cooldown": "'10 min'",
    "--repeat-by": "User",
    "--clock": "1s",
    "--csv": "results.csv",
    "--cut-set": "2",
    "--depth": "2",
    "--dialect": "duckdb",
    "--distinct": "id",
    "--engine": "duckdb",
    "--exec": "./alert.sh",
    "--exec-attack": "./page.sh",
    "--exec-fault": "./mail.sh",
    "--explain": "match.svg",
    "--fail-under": "80",
    "--foxglove": "8765",
    "--metrics": "/var/lib/node_exporter/rvaft.prom",
    "--gates": "and,or",
    "--highlight": "branch:2",
    "--host": "127.0.0.1",
    "--id": "robot",
    "--input": "csv",
    "--jobs": "2",
    "--json": "results.json",
    "--junit": "results.xml",
    "--key": "user",
    "--kind": "attack",
    "--languages": "rml,ltlf",
    "--latex": "tables.tex",
    "--length": "20",
    "--limit": "500",
    "--mapping": "fields.toml",
    "--markdown": "results.md",
    "--max-arity": "4",
    "--max-configurations": "1000",
    "--max-connections": "10",
    "--max-distinct": "1000",
    "--max-events": "5000",
    "--max-keys": "1000",
    "--max-message": "4",
    "--max-nodes": "8",
    "--memory": "2048",
    "--message-time": "seconds",
    "--monpoly": "./monpoly",
    "--oracle": "rml",
    "--order-by": "time",
    "--origin": "https://monitor.example",
    "--partition": "host",
    "--pattern": "'(?P<user>\\w+) (?P<event>\\w+)'",
    "--per": "kind",
    "--plots": "figures",
    "--polarity": "detection",
    "--port": "8080",
    "--position": "id",
    "--profile": "sshd",
    "--dbc": "car.dbc",
    "--messages": "ws/src",
    "--r2u2": "./r2u2",
    "--random": "100",
    "--records": "hits.hits",
    "--replay": "bogus",
    "--rml-monitor": "monitor",
    "--ros-version": "ros1",
    "--save-bogus": "bogus",
    "--seed": "7",
    "--semantics": "scattered",
    "--signature": "tree.sig",
    "--states": "1000",
    "--steps": "100000",
    "--table": "auth",
    "--template": "'{title}: {event}'",
    "--time": "ts",
    "--timeout": "60",
    "--to": "sql",
    "--traces": "50",
    "--types": "badge=text",
    "--verified": "./rvaft-verified",
    "--vocabulary": "strings",
    "--width": "60",
    "--window": "100",
    "--word": "'scan guess copy'",
    "--wrap": "20",
    "--year": "2026",
    "-n": "3",
}
"""A value for each option that takes one."""

_OWN: Final = {
    ("branches", "--format"): "--format latex",
    ("build", "--output"): "-o monitor",
    ("check", "--format"): "--format sarif",
    ("compare", "--width"): "--width column",
    ("attacks", "--format"): "--format csv",
    ("attacks", "--output"): "--list front -o front.svg",
    ("attacks", "--time"): "--time '100 h'",
    ("coverage", "--format"): "--format json",
    ("cut-sets", "--format"): "--format csv",
    ("cut-sets", "--most-probable"): "--most-probable --time '100 h'",
    ("cut-sets", "--time"): "--time '100 h' --most-probable",
    ("rates", "--format"): "--format tree",
    ("rates", "--per"): "--per d",
    ("risk", "--format"): "--format csv",
    ("risk", "--output"): "--time '1000 h' --curve 50 -o curve.svg",
    ("risk", "--semantics"): "--semantics projected --simulate 1000",
    ("risk", "--time"): "--time '1000 h'",
    ("emit", "--certify"): "--to rml --certify",
    ("emit", "--format"): "--format latex",
    ("emit", "--output"): "-o query.sql",
    ("emit", "--verified"): "--to rml --certify --verified ./rvaft-verified",
    ("fields", "--format"): "--format json",
    ("infer", "--output"): "-o tree.rvaft",
    ("monitor", "--format"): "--format jsonl",
    ("report", "--output"): "-o report.html",
    ("robust", "--format"): "--format json",
    ("rosmonitoring", "--output"): "-o config",
    ("show", "--format"): "--format dot",
    ("show", "--output"): "-o tree.svg",
    ("test", "--format"): "--format junit",
    ("traces", "--format"): "--format eql",
    ("traces", "--output"): "-o logs",
    ("traces", "--random"): "--random",
}
"""Examples of options whose values depend on the command."""
_WITHOUT_LOG: Final = frozenset({"--word"})
_WITHOUT_TREE: Final = frozenset({"--random", "--replay", "--gates", "--max-arity", "--max-nodes"})
_ESCAPES: Final = str.maketrans({"|": "\\|", "<": "&lt;", "[": "\\["})


def cell(text: str) -> str:
    """Return a text as it stands in a cell of a table in Markdown."""
    return " ".join(text.split()).translate(_ESCAPES)


def options(name: str) -> Iterator[tuple[click.Option, str, str]]:
    """Yield each option of a command with its names and its meaning; `--help` is left out."""
    context = click.Context(loaded(name), info_name=name)
    for parameter in loaded(name).get_params(context):
        if isinstance(parameter, click.Option) and "--help" not in parameter.opts:
            record = parameter.get_help_record(context)
            if record is not None:
                yield parameter, *record


def example(name: str, option: click.Option) -> str:
    """Return a call of a command with an option; raises `KeyError` for an option without an example."""
    long = max(option.opts, key=len)
    given = _OWN.get((name, long)) or (long if option.is_flag else f"{long} {_VALUES[long]}")
    call = CALLS[name]
    if long in _WITHOUT_LOG or (name == "robust" and long in ("-n", "--seed")):
        call = call.removesuffix(" log.jsonl")
    if long in _WITHOUT_TREE and name in ("cross-check", "compare"):
        call = ""
    if long in ("--to", "-o", "--output"):
        call = call.split(" -", 1)[0] if name != "emit" or long == "--to" else call
    if given.startswith("--to "):
        call = call.split(" -", 1)[0]
    return " ".join(f"rvaft {name} {call} {given}".split())


def page() -> str:
    """Return the page in Markdown."""
    introduction = (
        "# Commands and options\n\nThis page is generated from the parser. `rvaft COMMAND --help` prints the same text."
        "\n[Command line](command-line.md) explains formats and the exit status.\n"
    )
    parts = [introduction]
    context = click.Context(main, info_name="rvaft")
    for name in main.list_commands(context):
        command = loaded(name)
        usage = command.get_usage(click.Context(command, info_name=name, parent=context)).removeprefix("Usage: ")
        summary = "\n".join(line.strip() for line in (command.help or "").replace("\b", "").splitlines())
        rows = "".join(
            f"| `{names.replace('|', BAR)}` | {cell(text)} | `{example(name, option).replace('|', BAR)}` |\n"
            for option, names, text in options(name)
        )
        table = f"| option | meaning | example |\n| --- | --- | --- |\n{rows}" if rows else ""
        parts.append(f"## {name}\n\n```text\n{' '.join(usage.split())}\n```\n\n{summary}\n\n{table}")
    return "\n".join(parts)


BAR: Final = "\\|"
"""A bar in a cell of a table."""
