// Answers questions as the page would, in node, before the page is put anywhere: node prepare.mjs FOLDER < QUESTIONS
//
// QUESTIONS: JSON, a list of [route, message, file or null]. Answers with a file are written there, compressed. The last
// line says, in JSON, which files of Python all that took.

import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { pathToFileURL } from "node:url";
import { gzipSync } from "node:zlib";

const [folder] = process.argv.slice(2), file = (name) => new Uint8Array(readFileSync(name));
const { begin } = await import(pathToFileURL(`${folder}/engine.mjs`));
const { loadPyodide } = await import(pathToFileURL(`${folder}/pyodide/pyodide.mjs`));
const FILES = ["kernels.wasm", "kernels.json", "python.zip", "tables.bin"];
const { pyodide, unpack, ask } = await begin(loadPyodide, Object.fromEntries(FILES.map((name) => [name, file(`${folder}/${name}`)])));
for (const name of readdirSync(folder)) if (name.endsWith(".zip")) unpack(file(`${folder}/${name}`));
for (const [route, message, to] of JSON.parse(readFileSync(0))) {
  try {
    const answer = ask(route, message);
    if (to) writeFileSync(`${folder}/${to}`, gzipSync(answer, { level: 9 }));
  } catch (error) {
    if (to) throw error; // of the others some are refused
  }
}
console.log(pyodide.runPython("import json, sys; json.dumps([m.__file__ for m in sys.modules.values() if getattr(m, '__file__', None)])"));
