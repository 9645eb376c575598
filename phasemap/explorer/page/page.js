// The page: sliders on the left, what they do on the right. Every change asks the server for the image, then for the
// curves; the map of the contrast, and what takes long, come when they are ready.

import * as draw from "./draw.js";

const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#56b4e9", "#7a4b2a", "#555555"];
const EV = 1.602176634e-19, SLOW = 600, PATIENT = 3000, SETTLED = 350; // J, ms
const TOO_LONG = 503; // status of an answer that has no time left
const LEAST = 1; // degrees of phase between black and white, not to blow up last digits
const SOLVERS = { // what they are called, and what they do
  averaging: ["averaging", "First-order averaging, within the requested accuracy"],
  corrected: ["orbit (exact)", "The exact periodic orbit, from the lever's response to the force"],
  orbit: ["orbit (exact)", "The exact periodic orbit, by shooting"],
  march: ["in time", "The equation of motion, integrated in time"],
};
const $ = (id) => document.getElementById(id);
const round = (value, digits) => Number(value.toPrecision(digits));
const number = (value, digits) => (value === null ? "–" : String(round(value, digits)).replace("-", "−"));

let about; // what the server says of the sample
const inputs = []; // one for each knob
const now = { pair: [0, 0], row: null, here: null, held: null, picture: null, curves: null, map: null, mapKey: "", axes: null, took: {} };

// ---- asking

class Refused extends Error {
  constructor(sentence, code) { super(sentence); this.code = code; }
}

/** The answer to a message; an AbortError where `signal` takes the question back, so that the server stops working. */
async function ask(route, message, signal) {
  let answer;
  try {
    answer = await fetch(route, message === undefined ? {} : { method: "POST", body: JSON.stringify(message), signal });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Refused("The explorer is closed. Start it again with phasemap explore, or pm.explore.");
  }
  if (answer.ok) return answer;
  const said = await answer.json().catch(() => ({ error: `The server answers ${answer.status}.` }));
  throw new Refused(said.error, answer.status);
}

/** Asks again and again while settings change, one question at a time; one that is slow is taken back for the next. */
class Asker {
  constructor(route, take) { Object.assign(this, { route, take, busy: false, again: false }); }

  async run() {
    this.again = true;
    if (this.busy) { this.overtake(); return; }
    this.busy = true;
    const waits = [setTimeout(() => { say("solving …"); hideProblem(); }, SLOW), setInterval(sayWhatTakesLong, PATIENT)];
    while (this.again) {
      this.again = false;
      this.question = new AbortController();
      this.began = performance.now();
      try {
        await this.take(await ask(this.route, setting(), this.question.signal), this.began);
        complain("");
      } catch (error) {
        if (error.name === "AbortError") continue;
        complain(error.message);
        document.body.classList.add("stale"); // what is shown is not what the sliders say
      }
    }
    waits.forEach(clearTimeout); // which ends intervals too
    this.busy = false;
  }

  /** Takes the question back as soon as it is slow. */
  overtake() {
    const { question, began } = this;
    if (this.busy) setTimeout(() => question.abort(), Math.max(SLOW - (performance.now() - began), 0));
  }
}

async function sayWhatTakesLong() {
  const answer = await ask("doing", setting()).catch(() => null);
  if (answer && (picture.busy || curves.busy)) say((await answer.json()).doing);
}

function hideProblem() {
  $("problem").hidden = true;
  $("state").hidden = false;
}

function complain(sentence) {
  hideProblem();
  $("problem").textContent = sentence;
  $("problem").hidden = !sentence;
  $("state").hidden = Boolean(sentence);
  if (!sentence) document.body.classList.remove("stale");
}

const say = (sentence) => { $("state").textContent = sentence; };

/** What the sliders say, as the server wants it. */
function setting() {
  const message = { materials: about.materials.map(() => ({})), pair: now.pair, exact: $("exact").checked };
  for (const { knob, value } of inputs) {
    if (knob.material === null) message[knob.key] = value;
    else message.materials[knob.material][knob.key] = value;
  }
  const ratio = message.frequency / about.resonance;
  if (about.driven === null && Math.abs(ratio - 1) < 1e-9) message.frequency = null;
  return message;
}

// ---- answers

const picture = new Asker("picture", async (answer, began) => {
  take(await answer.arrayBuffer());
  now.took.image = performance.now() - began;
  curves.run();
});

const curves = new Asker("curves", async (answer, began) => {
  now.curves = await answer.json();
  drawCurves();
  now.took.curves = performance.now() - began;
  say(`image in ${Math.round(now.took.image)} ms, curves in ${Math.round(now.took.curves)} ms`);
});

function take(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const said = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const count = said.shape[0] * said.shape[1], start = 4 + length;
  now.picture = {
    ...said, height: new Float32Array(buffer, start, count), phase: new Float32Array(buffer, start + 4 * count, count),
  };
  drawImages();
  if (said.materials) drawWords();
}

let mapTimer = 0, mapQuestion = new AbortController();
function askForMap() {
  const { setpoint, free_amplitude, ...rest } = setting();
  const base = inputs.find(({ knob }) => knob.key === "free_amplitude").knob.start;
  const key = JSON.stringify([rest, Math.round(Math.log(free_amplitude / base) / Math.log(4))]);
  if (now.pair[0] === now.pair[1] || key === now.mapKey) { drawMap(); return; } // or it is being solved, or too long
  $("map-figure").classList.add("waiting");
  $("map-state").textContent = $("advice").textContent = "";
  clearTimeout(mapTimer);
  mapQuestion.abort(); // it was for another key
  const question = mapQuestion = new AbortController();
  now.mapKey = "";
  mapTimer = setTimeout(async () => {
    $("map-state").textContent = "is being solved …";
    now.mapKey = key;
    try {
      const answer = await ask("contrast", setting(), question.signal);
      now.map = await answer.json();
      $("map-figure").classList.remove("waiting");
      $("map-state").textContent = `${about.materials[now.pair[1]]} minus ${about.materials[now.pair[0]]}`;
      $("advice").textContent = `Where to work (◆): ${now.map.recommendation}`;
      drawMap();
    } catch (error) {
      if (error.name === "AbortError") return;
      $("map-state").textContent = "";
      if (error.code === TOO_LONG) { $("advice").textContent = error.message; return; }
      now.mapKey = "";
      complain(error.message);
    }
  }, SETTLED);
}

function changed() {
  picture.run();
  curves.overtake(); // they follow the next picture
  askForMap();
}

// ---- drawing

const QUANTITIES = [["height", "height (nm)"], ["phase", "phase (°)"]];

function drawImages() {
  const shown = now.picture;
  const [rows, columns] = shown.shape;
  now.row = Math.min(now.row ?? rows >> 1, rows - 1);
  if (!$("hold").checked || !now.held) now.held = { height: draw.limits(shown.height), phase: draw.limits(shown.phase, LEAST) };
  for (const [name, label] of QUANTITIES) {
    const values = shown[name], range = now.held[name], colours = about.colours[name];
    const box = draw.image($(name), values, shown.shape, shown.pixel, range, colours, label);
    now[`${name}Box`] = box;
    draw.marker($(name), box, Math.round(box.top + ((now.row + 0.5) / rows) * box.height) + 0.5);
    draw.histogram($(`${name}-histogram`), values, range, colours, label);
    draw.profile($(`${name}-profile`), values, shown.shape, shown.pixel[1], now.row, range, label);
  }
  const notes = shown.materials ? [] : [...shown.failed]; // the words say it of each material
  if (shown.far_off) notes.push(shown.far_off);
  if (shown.step > 1) notes.push(`Every ${shown.step === 2 ? "second" : `${shown.step}th`} pixel is shown; what is saved has all.`);
  if (about.control) notes.push(shown.materials ? `The tip is lowered onto each pixel anew (no memory of its neighbours)${about.sharp ? ", with sharp edges" : ""}.` : "This is the trace of the scan that the scene describes, until a slider moves.");
  $("note").textContent = notes.join(" ");
}

function drawWords() {
  const why = $("why");
  why.replaceChildren(...now.picture.why.map((line) => Object.assign(document.createElement("p"), { textContent: line })));
  const rows = now.picture.materials.flatMap((found, i) => {
    if (!found) return [];
    if (found.phase === null) Object.assign(found, { regime: "no orbit", solver: "–" });
    const regime = found.regime + (found.bistable ? ", bistable" : "") + (found.motion === "irregular" ? ", irregular" : "");
    const [solver, about_solver] = SOLVERS[found.solver] ?? [found.solver, ""];
    const cells = [
      found.name, regime, number(found.phase, 3), number(found.lost === null ? null : found.lost / EV, 3),
      number(found.indentation === null ? null : Math.max(found.indentation, 0) * 1e9, 3), solver,
    ].map((text) => Object.assign(document.createElement("td"), { textContent: text }));
    cells[0].prepend(dot(i));
    cells.at(-1).title = about_solver;
    const row = document.createElement("tr");
    row.append(...cells);
    return [row];
  });
  $("materials").tBodies[0].replaceChildren(...rows);
}

const ofPair = () => [...new Set(now.pair)].map((i) => ({ data: now.curves[about.materials[i]], colour: COLOURS[i] })).filter(({ data }) => data);

function drawCurves() {
  if (!now.curves || !ofPair().length) return;
  draw.curve($("amplitude-curve"), ofPair(), "amplitude", "amplitude (nm)");
  draw.curve($("phase-curve"), ofPair(), "phase", "phase (°)");
  draw.period($("period"), ofPair());
}

function drawMap() {
  if (!now.map) return;
  const { setpoint, free_amplitude } = setting();
  now.axes = draw.contrast($("map"), now.map, about.colours.contrast, [setpoint, free_amplitude * 1e9]);
}

function drawAll() {
  if (now.picture) drawImages();
  drawCurves();
  drawMap();
}

// ---- sliders

const STEPS = 1000;

function toSlider({ low, high, scale }, value) {
  if (scale === "log") return STEPS * (Math.log(value / low) / Math.log(high / low));
  return STEPS * (scale === "cubic" ? Math.cbrt(value / high) : (value - low) / (high - low));
}

function fromSlider({ low, high, scale, key }, at) {
  const part = at / STEPS;
  if (scale === "log") return round(low * (high / low) ** part, 3);
  if (scale === "cubic") return round(high * part ** 3, 3);
  return round(low + (high - low) * part, key === "frequency" ? 7 : 3);
}

function dot(i) {
  const mark = Object.assign(document.createElement("span"), { className: "dot" });
  mark.style.background = COLOURS[i];
  return mark;
}

function slider(knob, i) {
  const parts = Object.assign(document.createElement("div"), { className: "knob" });
  const label = Object.assign(document.createElement("label"), { textContent: knob.label, htmlFor: `knob-${i}` });
  const typed = Object.assign(document.createElement("input"), { type: "number", step: "any", id: `knob-${i}` });
  const unit = Object.assign(document.createElement("span"), { className: "unit", textContent: knob.unit });
  const range = Object.assign(document.createElement("input"), { type: "range", min: 0, max: STEPS, step: "any" });
  range.setAttribute("aria-label", `${knob.label}${knob.material === null ? "" : ` of ${about.materials[knob.material]}`}`);
  label.title = range.title = "Double-click to set it back";
  parts.append(label, typed, unit, range);
  const note = Object.assign(document.createElement("span"), { className: "note" });
  if (knob.key === "frequency") parts.append(note);
  const entry = { knob, value: knob.start };
  entry.set = (value) => {
    entry.value = value;
    typed.value = round(value / knob.size, knob.key === "frequency" ? 8 : 5);
    range.value = toSlider(knob, value);
    const off = value - about.resonance;
    note.textContent = Math.abs(off) < 0.5 ? "at resonance" : `${number(off, 4)} Hz from resonance`;
  };
  entry.set(knob.start);
  range.addEventListener("input", () => {
    let value = fromSlider(knob, Number(range.value));
    if (knob.key === "frequency" && Math.abs(value - about.resonance) < 0.012 * (knob.high - knob.low)) value = about.resonance;
    const at = range.value;
    entry.set(value);
    range.value = at; // a slider that is held does not jump
    changed();
  });
  typed.addEventListener("change", () => {
    if (typed.value === "") { entry.set(entry.value); return; }
    entry.set(Number(typed.value) * knob.size);
    changed();
  });
  for (const one of [label, range]) one.addEventListener("dblclick", () => { entry.set(knob.start); changed(); });
  inputs.push(entry);
  return parts;
}

function group(title, knobs) {
  const set = document.createElement("fieldset"), legend = document.createElement("legend");
  legend.append(...title);
  set.append(legend, ...knobs.map(([knob, i]) => slider(knob, i)));
  return set;
}

function tick(id, text, title, then) {
  const line = Object.assign(document.createElement("label"), { className: "switch", title });
  const box = Object.assign(document.createElement("input"), { type: "checkbox", id });
  box.addEventListener("change", then);
  line.append(box, text);
  return line;
}

function build() {
  $("name").textContent = about.name;
  document.title = `${about.name} – phasemap`;
  const knobs = about.knobs.map((knob, i) => [knob, i]), form = $("knobs");
  const options = group(["Options"], []);
  form.append(group(["Microscope"], knobs.filter(([knob]) => knob.material === null)));
  about.materials.forEach((name, m) => form.append(group([dot(m), name], knobs.filter(([knob]) => knob.material === m))));
  options.append(
    tick("exact", "exact orbits", "Solve every material exactly, also where averaging is within the accuracy", changed),
    tick("hold", "fix the colour scales", "Keep the colour scales as they are, to compare settings", drawAll),
  );
  const back = Object.assign(document.createElement("button"), { type: "button", textContent: "Reset all" });
  back.addEventListener("click", () => { for (const entry of inputs) entry.set(entry.knob.start); changed(); });
  options.append(back);
  form.append(options);
  form.addEventListener("submit", (event) => event.preventDefault());
  now.pair = [0, Math.min(1, about.materials.length - 1)];
  $("map-figure").hidden = about.materials.length < 2;
  if (about.materials.length > 2) {
    $("pair").hidden = false;
    ["first", "second"].forEach((id, which) => {
      $(id).append(...about.materials.map((name, i) => new Option(name, i)));
      $(id).value = now.pair[which];
      $(id).addEventListener("change", () => {
        now.pair[which] = Number($(id).value);
        if (now.pair[0] === now.pair[1]) {
          now.pair[1 - which] = (now.pair[which] + 1) % about.materials.length;
          $(which ? "first" : "second").value = now.pair[1 - which];
        }
        changed();
      });
    });
  }
  $("scan").hidden = !about.control;
  $("scan").textContent = "Scan in time as the scene says";
  $("scan").title = about.control ?? "";
}

// ---- mouse and buttons

function place(event, canvas, box) {
  const frame = canvas.getBoundingClientRect(), [rows, columns] = now.picture.shape;
  const row = Math.floor(((event.clientY - frame.top - box.top) / box.height) * rows);
  const column = Math.floor(((event.clientX - frame.left - box.left) / box.width) * columns);
  return row >= 0 && row < rows && column >= 0 && column < columns ? [row, column] : null;
}

for (const [name] of QUANTITIES) {
  const canvas = $(name);
  const point = (event) => {
    if (!now.picture) return;
    const at = place(event, canvas, now[`${name}Box`]);
    for (const [other] of QUANTITIES) {
      const value = at && now.picture[other][at[0] * now.picture.shape[1] + at[1]];
      $(`${other}-here`).textContent = at ? `${number(Number.isNaN(value) ? null : value, 4)} ${other === "height" ? "nm" : "°"}` : "";
    }
    if (at && event.buttons) { now.row = at[0]; drawImages(); }
  };
  canvas.addEventListener("pointermove", point);
  canvas.addEventListener("pointerdown", point);
  canvas.addEventListener("pointerleave", () => { for (const [other] of QUANTITIES) $(`${other}-here`).textContent = ""; });
}

function pointMap(event) {
  if (!now.axes || !event.buttons) return;
  const frame = $("map").getBoundingClientRect(), { axes } = now;
  const x = axes.atX(event.clientX - frame.left), y = axes.atY(event.clientY - frame.top);
  if (x < axes.xlim[0] || x > axes.xlim[1] || y < axes.ylim[0] || y > axes.ylim[1]) return;
  for (const entry of inputs) {
    if (entry.knob.key === "setpoint") entry.set(Math.min(round(x, 3), 0.99));
    if (entry.knob.key === "free_amplitude") entry.set(round(y * 1e-9, 3));
  }
  changed();
}
$("map").addEventListener("pointerdown", pointMap);
$("map").addEventListener("pointermove", pointMap);
$("map").title = "Click to use this setting";

async function saved(what) {
  const answer = await ask(`save/${what}`, setting());
  const buffer = await answer.arrayBuffer(), length = new DataView(buffer).getUint32(0, true);
  const { name, kind } = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  return { name, kind, content: buffer.slice(4 + length) };
}

/** Does what a button says, which is dead in the meantime. */
function button(id, busy, work) {
  const element = $(id);
  element.addEventListener("click", async () => {
    element.disabled = true;
    say(busy);
    try {
      say((await work()) ?? "");
      complain("");
    } catch (error) {
      say("");
      complain(error.message);
    } finally {
      element.disabled = false;
    }
  });
}

for (const what of ["scene", "image", "picture"]) {
  button(`save-${what}`, `the ${what} is being made …`, async () => {
    const file = await saved(what);
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([file.content], { type: file.kind }));
    link.download = file.name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    return `saved as ${file.name}`;
  });
}

button("copy-python", "…", async () => {
  const text = new TextDecoder().decode((await saved("python")).content);
  try {
    await navigator.clipboard.writeText(text);
    return "the Python is on the clipboard";
  } catch {
    $("python").querySelector("textarea").value = text;
    $("python").showModal();
    $("python").querySelector("textarea").select();
    return "";
  }
});

button("scan", "the scan is being simulated …", async () => {
  const began = performance.now(), answer = await ask("scan", setting());
  take(await answer.arrayBuffer());
  return `scan in ${((performance.now() - began) / 1000).toFixed(1)} s`;
});

try {
  about = await (await ask("start")).json();
  build();
  changed();
  new ResizeObserver(() => requestAnimationFrame(drawAll)).observe($("views"));
} catch (error) {
  say("");
  complain(error.message);
}
