// rvaft in Pyodide, away from the page, so that typing is never blocked.

const base = new URL("./playground/", import.meta.url).href;
let answer = null;

async function start() {
  let step = 0;
  const say = (text) => postMessage({ progress: ++step, text });
  say("Loading Python…");
  const { loadPyodide } = await import(`${base}pyodide.mjs`);
  const pyodide = await loadPyodide({ indexURL: base });
  say("Loading rvaft…");
  const wheels = await (await fetch(`${base}wheels.json`)).json();
  const archives = await Promise.all(wheels.map(async (name) => (await fetch(base + name)).arrayBuffer()));
  for (const archive of archives) pyodide.unpackArchive(archive, "wheel");
  say("Starting rvaft…");
  const program = await (await fetch(`${base}program.py`)).text();
  pyodide.runPython(program);
  answer = pyodide.globals.get("answer");
  say("Monitoring…");
  postMessage({ ready: true });
}

onmessage = ({ data }) => {
  try {
    postMessage({ number: data.number, found: JSON.parse(answer(JSON.stringify(data.request))) });
  } catch (error) {
    postMessage({ number: data.number, failed: String(error.message).trim().split("\n").at(-1) });
  }
};

start().catch((error) => postMessage({ broken: error.message }));
