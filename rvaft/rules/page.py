"""The reference page of the rules; `python -m rvaft.rules.page > docs/rules.md` writes it."""

from rvaft.rules.codes import CODES
from rvaft.rules.registry import RULES
from rvaft.rules.rule import Rule

_HEADER = """# What `rvaft check` looks for

Every finding ends with the code of its rule, as in `robot.rvaft:7:6: error: unknown event type radiaton; did you mean
radiation? [unknown-event]`. `rvaft explain CODE` prints what is written here. An error makes a tree unusable, a warning does not.
The rules about scenarios are asked only where the structure has no error. None of them enumerates branches.

| code | severity | finding |
| --- | --- | --- |
"""

_FOOTER = """
## Other codes

These are the codes of errors that stop the work; no finding on a tree has them.

"""


def page() -> str:
    """The page in Markdown: a table of all rules, each with a tree that breaks it and the tree mended, then the other codes."""
    rows = "".join(f"| [`{rule.code}`](#{rule.code}) | {rule.severity} | {rule.title} |\n" for rule in RULES.values())
    others = "".join(f"- `{code.code}`: {code.title}. {code.explanation}\n" for code in CODES.values())
    return _HEADER + rows + "".join(_section(rule) for rule in RULES.values()) + _FOOTER + others


def _section(rule: Rule) -> str:
    language = "python" if rule.python else "rvaft"
    return (
        f"\n## {rule.code}\n\n*{rule.severity}: {rule.title}.* {rule.explanation}\n\n"
        f"Not so:\n\n```{language}\n{rule.bad.strip()}\n```\n\nBut so:\n\n```{language}\n{rule.mended.strip()}\n```\n"
    )


if __name__ == "__main__":
    print(page(), end="")
