// How the page asks what computes: here the server of `phasemap explore`, over HTTP. What is asked, and how answers are
// read, is in engine.js; a page without a server has another module of this name.

export const TOO_LONG = 503; // code of a refusal for want of time
const ALIVE = 1000; // ms between two questions whether the server is there

export const refused = {}; // all that the form offers can be had

export class Refused extends Error {
  constructor(sentence, code) { super(sentence); this.code = code; }
}

/** The answer to a message; an AbortError where `signal` takes the question back, so that the server stops working. */
export async function ask(route, body, signal) {
  let answer;
  try {
    answer = await fetch(route, body === undefined ? {} : { method: "POST", body, signal });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Refused("The explorer does not answer.");
  }
  if (answer.ok) return answer;
  const said = await answer.json().catch(() => ({ error: `The server answers ${answer.status}.` }));
  throw new Refused(said.error, answer.status);
}

/** Calls `gone` with whether the server is gone, whenever that changes. */
export function watch(gone) {
  let was = false;
  setInterval(async () => {
    const is = await fetch("alive").then(() => false, () => true);
    if (is !== was) gone(was = is);
  }, ALIVE);
}

/** What to say where the engine is gone; `link` holds the state of the page. */
export const revival = (link) => `The explorer is closed. This opens it again as it is here: phasemap explore "${link}"`;
