// The playground: a tree and a log, monitored and translated in this page by a worker.

const LANGUAGES = { sigma: "Sigma", eql: "EQL", kql: "KQL", sql: "SQL", "sql-postgres": "PostgreSQL", c: "C", stix: "STIX", "match-recognize": "Flink", mfotl: "MFOTL", mtl: "MTL", rml: "RML" };
const SUFFIXES = { sigma: "yml", eql: "eql", kql: "kql", sql: "sql", "sql-postgres": "sql", c: "c", stix: "stix", "match-recognize": "sql", mfotl: "mfotl", mtl: "mtl", rml: "rml" };
const SYMBOLS = { "⊤": "detected", "⊥": "no longer possible", "?": "" };
const at = (name) => document.getElementById(`pg-${name}`);
const make = (tag, className, ...inner) => {
  const made = document.createElement(tag);
  if (className) made.className = className;
  made.append(...inner);
  return made;
};
const chosen = new Set(["sigma", "eql", "kql"]);
let worker = null, number = 0, shown = 0, last = null;

// Links: the tree and the log, compressed, in the last part of the address, which is not sent.

const bytesOf = async (stream) => new Uint8Array(await new Response(stream).arrayBuffer());
async function packed(value) {
  const bytes = await bytesOf(new Blob([JSON.stringify(value)]).stream().pipeThrough(new CompressionStream("deflate-raw")));
  return btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join("")).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
}
async function unpacked(text) {
  const bytes = Uint8Array.from(atob(text.replaceAll("-", "+").replaceAll("_", "/")), (letter) => letter.charCodeAt(0));
  return JSON.parse(new TextDecoder().decode(await bytesOf(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw")))));
}
const save = (name, text) => {
  const link = make("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "text/plain" }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
};
const copied = async (button, text) => {
  const before = button.textContent;
  try { await navigator.clipboard.writeText(text); button.textContent = "Copied"; } catch { prompt("Copy this:", text); }
  setTimeout(() => { button.textContent = before; }, 1500);
};

// Marks behind the text of a field: lines with a class.

const mark = (name, lines) => {
  const text = at(name).value.split("\n");
  at(`${name}-back`).replaceChildren(...text.map((line, place) => make("span", lines.get(place + 1) ?? "", `${line}\n`)));
  follow(name);
};
const follow = (name) => { at(`${name}-back`).scrollTop = at(name).scrollTop; at(`${name}-back`).scrollLeft = at(name).scrollLeft; };
const select = (name, line, column) => {
  const lines = at(name).value.split("\n"), start = lines.slice(0, line - 1).reduce((sum, one) => sum + one.length + 1, 0);
  at(name).focus();
  at(name).setSelectionRange(start + column - 1, start + Math.max((lines[line - 1] ?? "").length, column));
};
const place = (name, line, column, text, className) => {
  const button = make("button", "pg-link", `line ${line}: ${text}`);
  button.type = "button";
  button.addEventListener("click", () => select(name, line, column));
  return make("li", className, button);
};

function show(found) {
  last = found;
  const errors = found.errors ?? [], findings = found.findings ?? [];
  mark("tree", new Map([...findings.map(([line]) => [line, "pg-doubt"]), ...errors.map(([line]) => [line, "pg-wrong"])]));
  at("errors").replaceChildren(...errors.map(([line, column, text]) => place("tree", line, column, text, "pg-wrong")), ...findings.map(([line, column, text]) => place("tree", line, column, text, "pg-doubt")));
  if (errors.length) { at("state").textContent = "The tree has an error."; return; }
  at("state").textContent = "";
  at("drawing").innerHTML = found.drawing; // the text of the tree is escaped in the drawing
  const rank = new Map(found.names.map((name, position) => [name, position])), matched = new Set(found.nodes ?? []);
  for (const group of at("drawing").querySelectorAll("[data-node]")) {
    const name = found.names[Number(group.dataset.node)], events = found.matched.filter(([node]) => node === name).map(([, line]) => line);
    group.classList.toggle("lit", matched.has(name));
    const badge = group.querySelector(".badge");
    if (badge && events.length) badge.textContent = events.length > 1 ? `${events.length}×, line ${events.at(-1)}` : `line ${events[0]}`;
  }
  const ways = new Set((found.kept ?? []).map((ends) => ends.map((name) => rank.get(name)).join(" ")));
  for (const line of at("drawing").querySelectorAll("[data-line]")) line.classList.toggle("lit", ways.has(line.dataset.line));
  const lines = new Map(found.matched.map(([, line]) => [line, "pg-lit"]));
  if (found.wrong) lines.set(found.wrong[0], "pg-wrong");
  mark("log", lines);
  at("wrong").textContent = found.wrong ? `line ${found.wrong[0]}: ${found.wrong[1]}` : "";
  const final = found.lines.find(([, symbol]) => symbol !== "?");
  at("verdict").replaceChildren(make("strong", final ? (final[1] === "⊤" ? "pg-detected" : "") : "", final ? `${SYMBOLS[final[1]]} at line ${final[0]}` : "not detected"), ` under ${found.semantics}`);
  const why = [...found.matched.map(([node, line]) => `line ${line} is ${node}`), ...(found.variables ?? [])];
  at("why").replaceChildren(...why.map((text) => make("li", "", text)), ...found.near.map(([text, events]) => make("li", "", `near miss: ${text}`)));
  at("texts").replaceChildren(...Object.entries(found.texts).map(([name, [text, reason]]) => {
    const copy = make("button", "", "Copy"), keep = make("button", "", "Save"), head = make("p", "pg-bar", make("strong", "", LANGUAGES[name]));
    copy.type = keep.type = "button";
    copy.addEventListener("click", () => copied(copy, text));
    keep.addEventListener("click", () => save(`rule.${SUFFIXES[name]}`, text));
    if (text) head.append(copy, keep);
    const made = make("div", "pg-text", head, text ? make("pre", "", text) : make("p", "pg-refused", reason));
    made.dataset.language = name;
    return made;
  }));
}
function compared(found) {
  const said = found.comparison;
  if (found.errors.length) { at("comparison").textContent = "The tree has an error."; return; }
  if (said.error !== undefined) { at("comparison").textContent = said.error; return; }
  if (said.agree !== undefined) { at("comparison").textContent = `They agree on ${said.agree} logs${said.left_out ? `; ${said.left_out} were left out, for which the rule says nothing` : ""}.`; return; }
  const head = make("tr", "", ...["Event", "Tree", "Rule"].map((name) => make("th", "", name)));
  const rows = said.rows.map(([event, ...symbols]) => make("tr", "", make("td", "", make("code", "", event)), ...symbols.map((symbol) => make("td", "", symbol === "⊤" ? "⊤ detected" : symbol))));
  at("comparison").replaceChildren(make("p", "", `They differ on ${said.of} of the logs; the shortest one:`), make("table", "", make("thead", "", head), make("tbody", "", ...rows)));
}

const request = () => ({ tree: at("tree").value, log: at("log").value, semantics: at("semantics").value, languages: [...Object.keys(LANGUAGES)].filter((name) => chosen.has(name)) });
const waiting = new Map();
const ask = (given, act) => { waiting.set(++number, act); worker.postMessage({ number, request: given }); at("state").textContent = "Working…"; return number; };
let later = null;
const refresh = () => {
  clearTimeout(later);
  later = setTimeout(() => { const own = ask(request(), (found) => { if (own > shown) { shown = own; show(found); } }); }, 250);
};

async function start() {
  const examples = await (await fetch(new URL("./playground/examples.json", import.meta.url))).json();
  at("example").append(...examples.map((one, position) => { const made = make("option", "", one.name); made.value = position; return made; }));
  const put = (given) => { at("tree").value = given.tree; at("log").value = given.log; at("semantics").value = given.semantics ?? ""; };
  let given = examples[0];
  if (location.hash.startsWith("#p=")) {
    try { given = await unpacked(location.hash.slice(3)); at("example").prepend(make("option", "", "from the link")); at("example").selectedIndex = 0; } catch { at("state").textContent = "The link is damaged."; }
  }
  put(given);
  at("languages").append(...Object.entries(LANGUAGES).map(([name, title]) => {
    const box = make("input"), made = make("label", "", box, ` ${title}`);
    box.type = "checkbox";
    box.checked = chosen.has(name);
    box.id = `pg-language-${name}`;
    box.addEventListener("input", () => { if (box.checked) chosen.add(name); else chosen.delete(name); refresh(); });
    return made;
  }));
  for (const name of ["tree", "log"]) { at(name).addEventListener("scroll", () => follow(name)); mark(name, new Map()); }
  for (const name of ["tree", "log", "semantics"]) at(name).addEventListener("input", () => { if (name !== "semantics") mark(name, new Map()); refresh(); });
  at("example").addEventListener("input", () => { if (examples[at("example").value]) { put(examples[at("example").value]); refresh(); } });
  at("share").addEventListener("click", async () => {
    const { tree, log, semantics } = request();
    history.replaceState(null, "", `#p=${await packed({ tree, log, semantics })}`);
    copied(at("share"), location.href);
  });
  at("save-tree").addEventListener("click", () => save("tree.rvaft", at("tree").value));
  at("save-log").addEventListener("click", () => save("log.jsonl", at("log").value));
  at("copy-rule").addEventListener("click", () => { const name = at("rule-language").value; at("rule").value = name === "rvaft" ? at("tree").value : last?.texts?.[name]?.[0] ?? ""; });
  at("compare").addEventListener("click", () => { at("comparison").textContent = "Comparing…"; ask({ ...request(), rule: at("rule").value, language: at("rule-language").value }, (found) => { at("state").textContent = ""; compared(found); }); });

  worker = new Worker(new URL("./playground_worker.js", import.meta.url), { type: "module" });
  worker.addEventListener("message", ({ data }) => {
    if (data.broken !== undefined) at("state").textContent = `The playground could not start: ${data.broken}. See the end of this page.`;
    else if (data.progress !== undefined) { at("progress").value = 2 * data.progress; at("state").textContent = data.text; }
    else if (data.ready) { ask(request(), (found) => { show(found); at("progress").hidden = true; document.getElementById("playground").dataset.ready = "yes"; }); }
    else if (data.failed !== undefined) { at("state").textContent = data.failed; waiting.delete(data.number); }
    else { waiting.get(data.number)?.(data.found); waiting.delete(data.number); }
  });
}

start().catch((error) => {
  at("state").textContent = `The playground could not start: ${error.message}. See the end of this page.`;
});
