// A worker that answers what the page asks.

import { begin } from "./engine.mjs";
import { loadPyodide } from "./pyodide/pyodide.mjs";

const FILES = ["kernels.wasm", "kernels.json", "python.zip", "tables.bin"];
const bytes = async (name) => [name, new Uint8Array(await (await fetch(name)).arrayBuffer())];
const samples = {}; // those that are there, or on their way
const engine = Promise.all(FILES.map(bytes)).then((files) => begin(loadPyodide, Object.fromEntries(files)));
engine.then(() => postMessage({}), () => postMessage({ error: "The solver could not be loaded. Reload the page to try again." }));

onmessage = async ({ data: { id, route, message } }) => {
  try {
    const { ask, unpack } = await engine, { sample } = JSON.parse(message);
    await (samples[sample] ??= bytes(`${sample}.zip`).then(([, archive]) => unpack(archive)));
    const answer = ask(route, message);
    postMessage({ id, bytes: answer }, [answer.buffer]);
  } catch (error) {
    postMessage({ id, error: error.message });
  }
};
