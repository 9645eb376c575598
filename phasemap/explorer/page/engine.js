// What computes, as the rest of the page knows it: a question a function. asking.js carries questions there.

import { ask } from "./asking.js";

export { refused, revival, TOO_LONG, watch } from "./asking.js";

/** What is said in JSON at the beginning of an answer, and the bytes that follow. */
async function parted(answer) {
  const buffer = await answer.arrayBuffer(), length = new DataView(buffer).getUint32(0, true);
  return [JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length))), buffer, 4 + length];
}

const json = async (route, message, signal) => (await ask(route, message && JSON.stringify(message), signal)).json();

/** Height and phase, one after the other in a buffer from `start` on. */
function mapsIn(buffer, start, count) {
  return { height: new Float32Array(buffer, start, count), phase: new Float32Array(buffer, start + 4 * count, count) };
}

const countOf = ({ shape: [rows, columns] }) => rows * columns;

async function maps(route, message, signal) {
  const [said, buffer, start] = await parted(await ask(route, JSON.stringify(message), signal));
  return { ...said, ...mapsIn(buffer, start, countOf(said)) };
}

/** Samples, presets and colours. */
export const start = () => json("start");

/** Materials and values of a sample, the measured maps or null, and which material is where. */
export async function sample(name) {
  const [said, buffer, begin] = await parted(await ask("sample", JSON.stringify({ sample: name })));
  const measured = said.measured ? mapsIn(buffer, begin, countOf(said)) : null;
  return { ...said, measured, labels: new Uint8Array(buffer, begin + (measured ? 8 * countOf(said) : 0)) };
}

/** Opens a file; returns the name of the sample that it is. */
export const open = async (file) => (await (await ask(`open/${encodeURIComponent(file.name)}`, file)).json()).sample;

export const picture = (message, signal) => maps("picture", message, signal);
export const scan = (message) => maps("scan", message);
export const curves = (message, signal) => json("curves", message, signal);
export const contrast = (message, signal) => json("contrast", message, signal);

/** What is going on while an answer takes long. */
export const doing = async (message) => (await json("doing", message)).doing;

/** A file: scene, image, picture or python. */
export async function save(what, message) {
  const [{ name, kind }, buffer, begin] = await parted(await ask(`save/${what}`, JSON.stringify(message)));
  return { name, kind, content: buffer.slice(begin) };
}
