// How the page asks what computes: here Python and its kernels in workers of the page itself. There is no server.

export const TOO_LONG = 503; // code of a refusal for want of time
const LIMIT = 60000, SLOW = 5000; // ms that an answer may take, and after which it is stopped where nobody waits for it
const LONG = "This takes longer than the 60 s that the page has for an answer. phasemap explore solves it sooner, and phasemap run without a limit.";
const ELSEWHERE = "is not simulated in this page. Save the scene; phasemap run simulates it, and phasemap explore shows it.";

/** What cannot be had here, with reasons: routes, and choices of the form. */
export const refused = {
  scan: `A scan ${ELSEWHERE}`, "save/image": `The whole image ${ELSEWHERE}`,
  open: "Files are opened by phasemap explore: this page has no server that could read them.",
};

const prepared = fetch("prepared.json").then((answer) => answer.json()); // files of answers that were made with the page

export class Refused extends Error {
  constructor(sentence, code) { super(sentence); this.code = code; }
}

/** One worker, and the questions that wait for its answers. What takes too long, or is taken back late, ends with it. */
class Engine {
  constructor() {
    this.waiting = new Map(); // by numbers: what was asked, and what takes the answer
    this.begin();
  }

  begin() {
    this.worker = new Worker("worker.js", { type: "module" });
    this.there = false;
    this.ready = new Promise((ready, failed) => {
      this.worker.onmessage = ({ data: { id, bytes, error } }) => {
        const found = error === undefined ? new Response(bytes) : new Refused(error);
        if (id !== undefined) this.end(id, found);
        else if (error === undefined) ready(this.there = true);
        else failed(found);
      };
    });
    for (const { asked } of this.waiting.values()) this.worker.postMessage(asked);
  }

  /** Hands on an answer, or an error; nothing where nobody waits for it any more. */
  end(id, found) {
    const { take, refuse, timer } = this.waiting.get(id) ?? {};
    clearTimeout(timer);
    this.waiting.delete(id);
    (found instanceof Response ? take : refuse)?.(found);
  }

  /** The same, of a question that is still being answered. */
  stop(id, error) {
    this.end(id, error);
    this.worker.terminate();
    this.begin();
  }

  async ask(route, message, signal) {
    await this.ready; // which does not count
    signal?.throwIfAborted();
    const asked = { id: crypto.getRandomValues(new Uint32Array(1))[0], route, message }, { id } = asked, began = performance.now();
    const timer = setTimeout(() => this.stop(id, new Refused(LONG, TOO_LONG)), LIMIT);
    signal?.addEventListener("abort", () => {
      if (this.waiting.has(id)) (performance.now() - began > SLOW ? this.stop(id, signal.reason) : this.end(id, signal.reason));
    });
    this.worker.postMessage(asked);
    return new Promise((take, refuse) => this.waiting.set(id, { asked, take, refuse, timer }));
  }
}

let moving, patient; // what a slider waits for is not held up by what takes long

const load = () => { moving ??= new Engine(); };

/** Loads the solver while the first answers are looked at; in another page's frame once this one is touched. */
function loadSoon() {
  if (self === top) load();
  else for (const touched of ["pointerdown", "keydown"]) addEventListener(touched, load, { once: true });
}

async function sample(name) {
  const found = await fetch(`${encodeURIComponent(name)}.sample`);
  if (!found.ok) throw new Refused(`This page has no sample ${name}. phasemap explore opens files and links to them.`);
  return found;
}

/** The answer that was made with the page, if there is one. */
async function made(route, body, signal) {
  const { quick, ...asked } = JSON.parse(body), file = (await prepared)[`${route} ${JSON.stringify(asked)}`];
  if (file && quick) throw new Refused("The full answer is there as soon.");
  return file && new Response((await fetch(file, { signal })).body.pipeThrough(new DecompressionStream("gzip")));
}

/** Both images side by side, as they are seen. */
async function picture({ sample }) {
  const shown = ["height", "phase"].map((id) => document.getElementById(id)), [{ width, height }] = shown;
  const whole = Object.assign(document.createElement("canvas"), { width: 2 * width, height }), pen = whole.getContext("2d");
  pen.fillStyle = getComputedStyle(shown[0].parentElement).backgroundColor;
  pen.fillRect(0, 0, 2 * width, height);
  shown.forEach((one, i) => pen.drawImage(one, i * width, 0));
  const png = await new Promise((take) => whole.toBlob(take)), said = new TextEncoder().encode(JSON.stringify({ name: `${sample}.png`, kind: "image/png" }));
  return new Response(new Blob([new Uint32Array([said.length]), said, png]));
}

/** The answer to a message. */
export async function ask(route, body, signal) {
  if (route === "start") return fetch("start.json");
  if (route === "sample") return sample(JSON.parse(body).sample);
  if (route === "doing") return new Response(JSON.stringify({ doing: moving?.there ? "solving …" : "The solver is loading, only this once …" }));
  if (route === "save/picture") return picture(JSON.parse(body));
  if (route in refused) throw new Refused(refused[route]);
  const answer = await made(route, body, signal);
  if (route === "curves") loadSoon();
  if (answer) return answer;
  load();
  const one = route === "picture" || (route === "curves" && !patient?.there) ? moving : patient ??= new Engine();
  return one.ask(route, body, signal);
}

/** Nothing can go away. */
export const watch = () => {};

export const revival = (link) => link;
