"""Detections as alerts of security tools (ECS, OCSF, matches of Sigma), and by a template.

A rule has the title, id, level and tags that `rvaft emit --to sigma` writes. The time of an alert is
that of the detecting event, or the present time if the tree declares no time or cannot read it.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any, Final, NamedTuple, cast
from uuid import NAMESPACE_URL, uuid5

import rvaft
from rvaft.cli import options
from rvaft.cli.monitor_output import REPORTERS, MonitorSettings, Reporter, Sink
from rvaft.errors import OptionError
from rvaft.export.rule_metadata import rule_metadata
from rvaft.model.values import Json, finite
from rvaft.monitors import Explanation
from rvaft.stream.detection import detection
from rvaft.stream.keys import Field
from rvaft.stream.verdict_change import VerdictChange
from rvaft.support.terminal import readable_json, visible
from rvaft.support.wording import did_you_mean

ECS: Final = "8.11.0"
OCSF: Final = "1.4.0"
_LEVELS: Final = ("", "informational", "low", "medium", "high", "critical")
"""The levels of Sigma, in the order of the severities of OCSF."""
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_TACTICS: Final = {
    "reconnaissance": "TA0043",
    "resource_development": "TA0042",
    "initial_access": "TA0001",
    "execution": "TA0002",
    "persistence": "TA0003",
    "privilege_escalation": "TA0004",
    "defense_evasion": "TA0005",
    "credential_access": "TA0006",
    "discovery": "TA0007",
    "lateral_movement": "TA0008",
    "collection": "TA0009",
    "command_and_control": "TA0011",
    "exfiltration": "TA0010",
    "impact": "TA0040",
}
_CATEGORIES: Final = {
    "process_creation": "process",
    "network_connection": "network",
    "dns_query": "network",
    "file_event": "file",
    "registry_event": "registry",
    "webserver": "web",
    "proxy": "web",
    "authentication": "authentication",
}
"""The log sources of Sigma whose category ECS has."""
_RELATED: Final[Mapping[str, Sequence[str]]] = {
    "user": ("user.name",),
    "ip": ("source.ip", "destination.ip", "client.ip", "server.ip", "host.ip"),
    "hosts": ("host.name", "host.hostname"),
}
"""The fields of ECS whose values are related to an alert; other fields may mean anything."""


class Alert(NamedTuple):
    """A detection: its rule, the id, the JSON object for commands, and its times."""

    settings: MonitorSettings
    rule: Mapping[str, Any]
    id: str
    found: Mapping[str, Any]
    time: datetime
    times: Sequence[datetime]

    @classmethod
    def of(
        cls,
        settings: MonitorSettings,
        rule: Mapping[str, Any],
        change: VerdictChange,
        explanation: Explanation,
        counts: Mapping[str, Json],
    ) -> "Alert":
        """Return the alert of a rule for an explanation."""
        about = {"tree": settings.name, "trace": change.watch.trace, **settings.key(change.watch)}
        about |= {"event": change.number, "line": change.line}
        own = json.dumps([about, explanation.branch, explanation.matched])
        found = detection({**about, **counts}, explanation, change.events, settings.tree, change.lines)
        known = [time for event in change.events.values() if (time := _moment(settings, event)) is not None]
        now = _moment(settings, change.event) or datetime.now(tz=UTC)
        return cls(settings, rule, str(uuid5(NAMESPACE_URL, f"{rule['id']} {own}")), found, now, sorted(known))

    @property
    def documents(self) -> list[dict[str, Any]]:
        """The matched events, each with its node and number."""
        names = ("node", "occurrence", "event", "line")
        return [
            {**{name: one[name] for name in names}, "document": self.found["events"].get(str(one["event"]))}
            for one in self.found["matched"]
        ]

    @property
    def attacks(self) -> tuple[list[str], list[str]]:
        """The tactics and the techniques of ATT&CK in the tags."""
        tags = [tag.strip().lower() for tag in self.rule.get("tags", ())]
        names = [tag.removeprefix("attack.").replace("-", "_") for tag in tags if tag.startswith("attack.")]
        techniques = [name.upper() for name in names if re.fullmatch(r"t[0-9]{4}(\.[0-9]{3})?", name)]
        return [name for name in names if name in _TACTICS], techniques


def _moment(settings: MonitorSettings, event: Json) -> datetime | None:
    time = None if settings.tree.time is None or event is None else settings.tree.time.read(event)
    try:
        return None if time is None else _EPOCH + timedelta(microseconds=int(time) // 1000)
    except OverflowError:
        return None


def _iso(time: datetime) -> str:
    return time.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _sigma(alert: Alert) -> dict[str, Any]:
    found = {name: value for name, value in alert.found.items() if name not in ("matched", "events")}
    return {"timestamp": _iso(alert.time), **alert.rule, **found, "matches": alert.documents}


def _ecs(alert: Alert) -> dict[str, Any]:
    attributes = dict(alert.settings.tree.nodes[alert.settings.tree.root].attributes)
    rule, (tactics, techniques), level = alert.rule, alert.attacks, alert.rule["level"]
    event: dict[str, Any] = {"kind": "alert", "id": alert.id, "module": "rvaft", "dataset": "rvaft.alert"}
    if attributes.get("category") in _CATEGORIES:
        event["category"] = [_CATEGORIES[attributes["category"]]]
    event |= {"severity": _LEVELS.index(level)} if level in _LEVELS[1:] else {}
    event |= {"start": _iso(alert.times[0]), "end": _iso(alert.times[-1])} if alert.times else {}
    about: dict[str, Any] = {"id": rule["id"], "name": rule["title"], "description": rule["description"]}
    about |= {"reference": attributes["reference"]} if "reference" in attributes else {}
    about |= {"author": [rule["author"]]} if "author" in rule else {}
    made = {"@timestamp": _iso(alert.time), "ecs": {"version": ECS}, "message": rule["title"]}
    made |= {"event": event, "rule": about}
    if tactics or techniques:
        names = [name.replace("_", " ").title().replace("And", "and") for name in tactics]
        technique: dict[str, Any] = {"id": list(dict.fromkeys(one.partition(".")[0] for one in techniques))}
        parts = [one for one in techniques if "." in one]
        technique |= {"subtechnique": {"id": parts}} if parts else {}
        made["threat"] = {"framework": "MITRE ATT&CK"}
        made["threat"] |= {"tactic": {"id": [_TACTICS[one] for one in tactics], "name": names}} if tactics else {}
        made["threat"] |= {"technique": technique} if techniques else {}
    related: dict[str, list[str]] = {}
    for name, fields in _RELATED.items():
        values = [Field.parse(field).of(event) for field in fields for event in alert.found["events"].values()]
        if texts := {one[0] for one in values if one is not None and isinstance(one[0], str)}:
            related[name] = sorted(texts)
    made |= {"related": related} if related else {}
    made |= {"tags": rule["tags"]} if "tags" in rule else {}
    return {**made, "rvaft": {name: value for name, value in alert.found.items() if name != "events"}}


def _ocsf(alert: Alert) -> dict[str, Any]:
    rule, (tactics, techniques), level = alert.rule, alert.attacks, alert.rule["level"]
    severity = _LEVELS.index(level) if level in _LEVELS[1:] else 0
    attacks: list[Json] = [{"tactic": {"uid": _TACTICS[one]}} for one in tactics]
    for one in techniques:
        below: dict[str, Json] = {"sub_technique": {"uid": one}} if "." in one else {}
        attacks.append({"technique": {"uid": one.partition(".")[0]}, **below})
    product = {"name": "rvaft", "vendor_name": "rvaft", "version": rvaft.__version__}
    analytic = {"type_id": 1, "type": "Rule", "uid": rule["id"], "name": rule["title"]}
    finding = {"uid": alert.id, "title": rule["title"], "desc": rule["description"], "analytic": analytic}
    finding |= {"attacks": attacks} if attacks else {}
    made = {
        "activity_id": 1,
        "category_uid": 2,
        "class_uid": 2004,
        "type_uid": 200401,
        "severity_id": severity,
        "severity": _LEVELS[severity].title() or "Unknown",
        "time": _milliseconds(alert.time),
        "message": rule["title"],
        "status_id": 1,
        "is_alert": True,
        "metadata": {"version": OCSF, "product": product, "log_name": alert.found["trace"]},
        "finding_info": finding,
        "evidences": [{"data": one} for one in alert.documents],
    }
    if alert.times:
        made |= {"start_time": _milliseconds(alert.times[0]), "end_time": _milliseconds(alert.times[-1])}
    return {**made, "unmapped": {name: one for name, one in alert.found.items() if name not in ("matched", "events")}}


def _milliseconds(time: datetime) -> int:
    return (time - _EPOCH) // timedelta(milliseconds=1)


class _Alerts(Reporter):
    """Prints a line per detection."""

    whole, each_key = True, False

    def __init__(self, settings: MonitorSettings, sink: Sink, made: Callable[[Alert], str]) -> None:
        super().__init__(settings, sink)
        self._made, self._rule = made, rule_metadata(settings.tree)

    def change(self, change: VerdictChange) -> None:
        for explanation, _, count in change.detections:
            assert explanation is not None, "backends are refused"
            counts: dict[str, Json] = {} if count is None else dict(count.fields)
            counts |= {"again": True} if change.number <= self.reported_before else {}
            alert = Alert.of(self.settings, self._rule, change, explanation, counts)
            self.sink.write(f"{self._made(alert)}\n")


def _printing(form: Callable[[Alert], dict[str, Any]]) -> Callable[[MonitorSettings, Sink], Reporter]:
    return lambda settings, sink: _Alerts(settings, sink, lambda alert: json.dumps(form(alert)))


def _templated(settings: MonitorSettings, sink: Sink) -> Reporter:
    assert settings.template is not None, "the form is given by the template"
    return _Alerts(settings, sink, Template(settings.template, settings).filled)


FORMS: Final = ("ecs", "ocsf", "sigma")
ALL_REPORTERS: Final[Mapping[str, Callable[[MonitorSettings, Sink], Reporter]]] = {
    **REPORTERS,
    "ecs": _printing(_ecs),
    "ocsf": _printing(_ocsf),
    "sigma": _printing(_sigma),
    "template": _templated,
}
_PLACEHOLDER: Final = re.compile(r"\{([A-Za-z_]\w*)(?:\.([^{}:\s]+)|:(event|line|time))?\}")
_FOUND: Final = ("tree", "trace", "key", "event", "line", "branch", "kinds", "variables", "matched", "absent")
_RULE: Final = ("title", "level", "tags", "description")
_OWN: Final[Mapping[str, Callable[[Alert], Json]]] = {
    "root": lambda alert: alert.settings.tree.root,
    "rule": lambda alert: cast("str", alert.rule["id"]),
    "id": lambda alert: alert.id,
    "time": lambda alert: _iso(alert.time),
}
_LISTED: Final = 30


class Template:
    """A text with placeholders; one that begins as JSON must be JSON, and is printed on one line.

    Raises `OptionError` for an unknown placeholder. `@FILE` reads the text from a file.
    """

    def __init__(self, text: str, settings: MonitorSettings) -> None:
        if text.startswith("@"):
            try:
                text = options.read_named(text[1:]).decode("utf-8").replace("\r\n", "\n")
            except UnicodeDecodeError as error:
                raise OptionError(f"--template: {text[1:]} is not UTF-8") from error
        text = text.removesuffix("\n")
        if not text.strip():
            raise OptionError("--template: the text is empty")
        self._settings = settings
        self._is_json = re.match(r'\s*\{\s*["}]', text) is not None
        self._parts: list[tuple[str, tuple[str, ...] | None, bool]] = []
        """Texts, or placeholders with whether they are in a JSON string."""
        at = 0
        for brace in re.finditer(r"\{\{|\{(?=[A-Za-z_])", text):
            if brace.start() < at:
                continue
            self._parts.append((text[at : brace.start()], None, False))
            place = _PLACEHOLDER.match(text, brace.start())
            if brace[0] == "{{":
                self._parts.append(("{", None, False))
            elif place is None:
                shown = text[brace.start() : brace.start() + 20]
                raise OptionError(f"--template: {shown!r} begins no placeholder; write a brace itself as {{{{")
            else:
                before = re.sub(r"\\.", "", "".join(one for one, name, _ in self._parts if name is None))
                self._parts.append((place[0], self._known(place), before.count('"') % 2 == 1))
            at = brace.end() if place is None else place.end()
        self._parts.append((text[at:], None, False))
        if self._is_json:
            self._as_json(lambda _: None)

    def _known(self, place: re.Match[str]) -> tuple[str, ...]:
        name, field, of = place.groups()
        tree = self._settings.tree
        known = [*(() if field or of else (*_FOUND, *_RULE, *_OWN, *tree.variables)), *tree.occurrences]
        if name not in known:
            guess = did_you_mean(name, known) or f"; known are {', '.join(known[:_LISTED])}"
            raise OptionError(f"--template: unknown placeholder {place[0]}{guess}")
        return name, "" if field is None else Field.parse(field).text, of or ""

    def _value(self, alert: Alert, name: str, field: str, of: str) -> Json:
        if not field and not of:
            if name in _OWN:
                return _OWN[name](alert)
            for names, known in ((_FOUND, alert.found), (_RULE, alert.rule)):
                if name in names:
                    return cast("Json", known.get(name))
            if name in self._settings.tree.variables:
                return cast("Json", alert.found["variables"].get(name))
        own = [one for one in alert.found["matched"] if one["node"] == name]
        values = [one.get(of or "event") for one in own]
        if field:
            found = [Field.parse(field).of(alert.found["events"].get(str(number))) for number in values]
            values = [None if one is None else one[0] for one in found]
        several = self._settings.tree.nodes[name].times > 1
        return values if several else values[0] if values else None

    def _as_json(self, value: Callable[[tuple[str, ...]], Json]) -> str:
        made = ""
        for text, place, inside in self._parts:
            if place is None:
                made += text
            else:
                found = value(place)
                made += json.dumps(_plain(found))[1:-1] if inside else json.dumps(finite(found))
        try:
            return json.dumps(json.loads(made))
        except ValueError as error:
            raise OptionError(f"--template: it begins as JSON, but is not JSON: {error}") from None

    def filled(self, alert: Alert) -> str:
        """Return the text with the values of an alert."""
        if self._is_json:
            return self._as_json(lambda place: self._value(alert, *place))
        values = (
            text if place is None else visible(_plain(self._value(alert, *place))) for text, place, _ in self._parts
        )
        return "".join(values)


def _plain(value: Json) -> str:
    if isinstance(value, list):
        return ", ".join(map(_plain, value)) or "-"
    return "-" if value is None else value if isinstance(value, str) else readable_json(value)
