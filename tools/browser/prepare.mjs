// Answers questions as the page would, in node, before the page is put anywhere: node prepare.mjs FOLDER < QUESTIONS
//
// QUESTIONS: JSON, a list of [route, message, file or null]. Answers with a file are written there, compressed. The last
// line says, in JSON, which modules of Python all that took: their compiled code by the names of their files.

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
console.log(pyodide.runPython(`
import base64, json, marshal, sys
from importlib.util import MAGIC_NUMBER

def bare(code):  # without the numbers of lines, a third of it
    parts = tuple(bare(one) if isinstance(one, type(code)) else one for one in code.co_consts)
    full, rest = divmod(len(code.co_code) // 2, 8)  # an entry without a place is of one to eight instructions
    return code.replace(co_linetable=b"\\xff" * full + bytes([0xF7 + rest] * (rest > 0)), co_consts=parts)

def code(module):  # as files .pyc have it; Pyodide needs its docstrings
    if module.__spec__.origin == "frozen":  # into the interpreter
        return None
    source = module.__loader__.get_source(module.__name__)
    made = compile(source, module.__file__, "exec", dont_inherit=True, optimize=0 if "pyodide" in module.__file__ else 2)
    return base64.b64encode(MAGIC_NUMBER + b"\\1\\0\\0\\0" + bytes(8) + marshal.dumps(bare(made))).decode()

json.dumps({one.__file__: code(one) for one in list(sys.modules.values()) if (getattr(one, "__file__", None) or "").endswith(".py")})
`));
