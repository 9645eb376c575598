// Answers cases.py as the page would, in node: the last line is JSON.

import { readdirSync, readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [folder] = process.argv.slice(2), file = (name) => new Uint8Array(readFileSync(name));
const { begin } = await import(pathToFileURL(`${folder}/engine.mjs`));
const { loadPyodide } = await import(pathToFileURL(`${folder}/pyodide/pyodide.mjs`));
const FILES = ["kernels.wasm", "kernels.json", "python.zip", "tables.bin"];
const { pyodide, unpack } = await begin(loadPyodide, Object.fromEntries(FILES.map((name) => [name, file(`${folder}/${name}`)])));
for (const name of readdirSync(folder)) if (name.endsWith(".zip")) unpack(file(`${folder}/${name}`));
pyodide.FS.writeFile("/page/cases.py", file(new URL("cases.py", import.meta.url)));
console.log(pyodide.runPython("import browser_engine, cases; cases.said(browser_engine.subject)"));
