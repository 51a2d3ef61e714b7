// The playground: rvaft in Pyodide, from files beside this script.

const TREE = `time time as s;
break_in sand scan login copy  within 1 h  label "Data stolen";
login    or   guess leak attack;
scan;  copy;  guess;  leak;
`;
const LOG = `{"time": 12.1, "event": "scan", "from": "10.0.0.7"}
{"time": 12.4, "event": "heartbeat"}
{"time": 13.0, "event": "guess", "user": "admin"}
{"time": 19.8, "event": "copy", "files": 312}
`;
const PROGRAM = `
import json
import rvaft
from rvaft.errors import RvaftError
from rvaft.export.svg import svg_text

def answer(text, log, semantics, language):
    try:
        tree = rvaft.loads(text, "tree.rvaft")
        findings = rvaft.check(tree)
    except RvaftError as error:
        return json.dumps({"error": str(error)})
    rows = [f"{one.severity}: {one.message} [{one.code}]" for one in findings]
    monitor = rvaft.monitor(tree, semantics=semantics)
    try:
        for number, line in enumerate(filter(str.strip, log.splitlines()), 1):
            event = json.loads(line)
            if not isinstance(event, dict):
                raise ValueError(f"line {number} is not a JSON object")
            rows.append(f"{monitor.step(event).symbol}  {line}")
    except (ValueError, RvaftError) as error:
        rows.append(f"error: {error}")
    explanation = monitor.explanation
    if explanation is not None:
        rows.append("")
        for one in explanation.matched:
            rows.append(f"event {one.event} is {one.node}")
        rows += [f"{name} = {value!r}" for name, value in explanation.variables.items()]
    try:
        written = rvaft.translate(tree, language, semantics=semantics).text
    except RvaftError as error:
        written = str(error)
    return json.dumps({"drawing": svg_text(tree), "verdicts": "\\n".join(rows), "text": written})
`;

const at = (name) => document.getElementById(`pg-${name}`);

async function start() {
  const base = new URL("./playground/", import.meta.url).href;
  const { loadPyodide } = await import("./playground/pyodide.mjs");
  const pyodide = await loadPyodide({ indexURL: base });
  const wheels = await (await fetch(`${base}wheels.json`)).json();
  for (const name of wheels) {
    pyodide.unpackArchive(await (await fetch(base + name)).arrayBuffer(), "wheel");
  }
  pyodide.runPython(PROGRAM);
  const answer = pyodide.globals.get("answer");
  const show = () => {
    const found = JSON.parse(answer(at("tree").value, at("log").value, at("semantics").value, at("language").value));
    at("state").textContent = found.error ?? "";
    if (found.error === undefined) {
      at("drawing").innerHTML = found.drawing; // the text of the tree is escaped in the drawing
      at("verdicts").textContent = found.verdicts;
      at("text").textContent = found.text;
    }
  };
  at("tree").value = TREE;
  at("log").value = LOG;
  for (const name of ["tree", "log", "semantics", "language"]) at(name).addEventListener("input", show);
  show();
  document.getElementById("playground").dataset.ready = "yes";
}

start().catch((error) => {
  at("state").textContent = `The playground could not start: ${error.message}. Build it with "make playground".`;
});
