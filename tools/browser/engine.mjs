// What answers the page where there is no server: the package's own Python, run by Pyodide, and its kernels in WebAssembly.

import { Kernels } from "./kernels.mjs";

/** Begins with files as bytes: `kernels.wasm`, `kernels.json`, `python.zip`, `tables.bin`. Returns what answers. */
export async function begin(loadPyodide, files, options = {}) {
  const text = (name) => new TextDecoder().decode(files[name]);
  const table = JSON.parse(text("kernels.json"));
  const [pyodide, kernels] = await Promise.all([loadPyodide(options), Kernels.load(files["kernels.wasm"], table)]);
  const call = (name, parts, buffers) => {
    const of = buffers.toJs({ depth: 1 }), views = of.map((one) => one.getBuffer("u8"));
    try {
      return pyodide.toPy(kernels.call(name, parts.toJs(), views.map((one) => one.data)));
    } finally {
      views.forEach((one) => one.release());
      of.forEach((one) => one.destroy());
    }
  };
  const keep = (buffer) => {
    const view = buffer.getBuffer("u8");
    try { return kernels.keep(view.data); } finally { view.release(); }
  };
  const unpack = (archive) => pyodide.unpackArchive(archive, "zip", { extractDir: "/page" });
  unpack(files["python.zip"]);
  pyodide.FS.writeFile("/page/tables.bin", files["tables.bin"]);
  pyodide.runPython("import sys; sys.path.insert(0, '/page')");
  const engine = pyodide.pyimport("browser_engine");
  engine.begin(call, keep, pyodide.toPy(table.entries), pyodide.toPy(kernels.formulas));
  return {
    pyodide,
    /** Takes in a sample. */
    unpack,
    /** The bytes that the server would answer; an error has a sentence. */
    ask(route, message) {
      const [good, answer] = engine.answer(route, message ?? "").toJs();
      if (!good) throw new Error(answer);
      return answer;
    },
  };
}
