// How the page asks what computes: here Python and its kernels in workers of the page itself. There is no server.

export const TOO_LONG = 503; // code of a refusal for want of time
const LIMIT = 60000, SLOW = 5000; // ms that an answer may take, and after which it is stopped where nobody waits for it
const LONG = "This takes longer than the 60 s that the page has for an answer. phasemap explore solves it sooner, and phasemap run without a limit.";
const ELSEWHERE = "is not simulated in this page. Save the scene; phasemap run simulates it, and phasemap explore shows it.";
const REFUSED = {
  scan: `A scan ${ELSEWHERE}`, "save/image": `The whole image ${ELSEWHERE}`, "save/picture": `The whole image ${ELSEWHERE}`,
  open: "Files are opened by phasemap explore: this page has no server that could read them.",
};

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
    this.worker.onmessage = ({ data: { id, bytes, error } }) => this.end(id, error === undefined ? new Response(bytes) : new Refused(error));
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

  ask(route, message, signal) {
    const asked = { id: crypto.getRandomValues(new Uint32Array(1))[0], route, message }, { id } = asked, began = performance.now();
    const timer = setTimeout(() => this.stop(id, new Refused(LONG, TOO_LONG)), LIMIT);
    signal?.addEventListener("abort", () => {
      if (this.waiting.has(id)) (performance.now() - began > SLOW ? this.stop(id, signal.reason) : this.end(id, signal.reason));
    });
    this.worker.postMessage(asked);
    return new Promise((take, refuse) => this.waiting.set(id, { asked, take, refuse, timer }));
  }
}

const moving = new Engine(); // what a slider waits for is not held up by what takes long
let patient; // begun when it is first needed

/** The answer to a message. */
export async function ask(route, body, signal) {
  if (route === "start") return fetch("start.json");
  if (route === "sample") return fetch(`${JSON.parse(body).sample}.sample`);
  if (route === "doing") return new Response(JSON.stringify({ doing: moving.begun ? "solving …" : "Python and its kernels are loading, only this once …" }));
  const refused = REFUSED[route.split("/")[0]] ?? REFUSED[route];
  if (refused) throw new Refused(refused);
  if (route !== "picture") return (patient ??= new Engine()).ask(route, body, signal);
  const answer = await moving.ask(route, body, signal);
  moving.begun = true;
  return answer;
}

/** Nothing can go away. */
export const watch = () => {};

export const revival = (link) => link;
