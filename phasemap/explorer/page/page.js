// The page: sliders on the left, what they do on the right. Every change asks the engine for the image, then for the
// curves; the map of the contrast, and what takes long, come when they are ready.

import * as controls from "./controls.js";
import * as draw from "./draw.js";
import * as engine from "./engine.js";
import { begin, changes, fromLink, message, state, toLink } from "./state.js";

const EV = 1.602176634e-19, SLOW = 600, PATIENT = 1500, SETTLED = 350; // J, ms
const LEAST = 1; // degrees of phase between black and white, not to blow up last digits
const OPEN = "open a file …", SWITCHES = ["exact", "lag"];
const SOLVERS = { // what they are called, and what they do
  averaging: ["averaging", "First-order averaging, within the requested accuracy"],
  corrected: ["orbit (exact)", "The exact periodic orbit, from the lever's response to the force"],
  orbit: ["orbit (exact)", "The exact periodic orbit, by shooting"],
  march: ["in time", "The equation of motion, integrated in time"],
};
const $ = (id) => document.getElementById(id);
const round = (value, digits) => Number(value.toPrecision(digits));
const number = (value, digits) => (value === null ? "–" : String(round(value, digits)).replace("-", "−"));

let offer; // samples, presets and colours
let about; // what the engine says of the sample
let knobs; // as knobs.json declares them
const nothing = { row: null, held: null, picture: null, curves: null, map: null, mapKey: "", axes: null };
const now = { ...nothing, took: {}, gone: false };

// ---- asking

/** Asks again and again while settings change, one question at a time; one that is slow is taken back for the next. */
class Asker {
  constructor(question, take) { Object.assign(this, { ask: question, take, busy: false, again: false }); }

  async run() {
    this.again = true;
    if (this.busy) { this.overtake(); return; }
    this.busy = true;
    const waits = [setTimeout(() => { say("solving …"); hideProblem(); sayWhatTakesLong(); }, SLOW), setInterval(sayWhatTakesLong, PATIENT)];
    while (this.again) {
      this.again = false;
      this.question = new AbortController();
      this.began = performance.now();
      try {
        await this.take(await this.ask(message(), this.question.signal), this.began);
        complain("");
      } catch (error) {
        if (error.name === "AbortError") continue;
        complain(error.message);
        document.body.classList.add("stale"); // what is shown is not what the sliders say
      }
    }
    waits.forEach(clearTimeout); // which ends intervals too
    this.busy = false;
    if (!picture.busy) delete $("pictures").dataset.doing;
  }

  /** Takes the question back as soon as it is slow. */
  overtake() {
    const { question, began } = this;
    if (this.busy) setTimeout(() => question.abort(), Math.max(SLOW - (performance.now() - began), 0));
  }
}

async function sayWhatTakesLong() {
  const doing = await engine.doing(message()).catch(() => null);
  if (doing === null || !(picture.busy || curves.busy)) return;
  say(doing);
  drawWaiting(doing);
  if (picture.busy && now.picture) $("pictures").dataset.doing = doing; // the one in sight is not yet what the sliders say
}

function hideProblem() {
  $("problem").hidden = true;
  $("state").hidden = false;
}

function complain(sentence) {
  if (now.gone) return; // which is said
  hideProblem();
  $("problem").textContent = sentence;
  $("problem").hidden = !sentence;
  $("state").hidden = Boolean(sentence);
  if (!sentence) document.body.classList.remove("stale");
}

const say = (sentence) => { $("state").textContent = sentence; };

const picture = new Asker(async (asked, signal) => {
  if (!now.picture) await engine.picture({ ...asked, quick: true }, signal).then(take, stopIfTakenBack); // compiled soonest
  return engine.picture(asked, signal);
}, (answer, began) => {
  take(answer);
  now.took.image = performance.now() - began;
  curves.run();
});

const curves = new Asker(engine.curves, (answer, began) => {
  now.curves = answer;
  drawCurves();
  now.took.curves = performance.now() - began;
  say(`image in ${Math.round(now.took.image)} ms, curves in ${Math.round(now.took.curves)} ms`);
  askForMap(); // the first time after all else, which it would hold up
});

function stopIfTakenBack(error) {
  if (error.name === "AbortError") throw error; // any other reason is that of the full answer too
}

function take(answer) {
  now.picture = answer;
  drawImages();
  if (answer.materials) drawWords();
}

let mapTimer = 0, mapQuestion = new AbortController();
function askForMap() {
  const { changes: { "scan.setpoint": _, "drive.free_amplitude": __, ...rest }, ...others } = message();
  const amplitude = state.values["drive.free_amplitude"] / state.start["drive.free_amplitude"];
  const key = JSON.stringify([rest, others, Math.round(Math.log(amplitude) / Math.log(4))]);
  if (!now.curves || state.pair[0] === state.pair[1] || key === now.mapKey) { drawMap(); return; } // or it is being solved, or too long
  $("map-figure").classList.add("waiting");
  $("map-state").textContent = $("advice").textContent = "";
  clearTimeout(mapTimer);
  mapQuestion.abort(); // it was for another key
  const question = mapQuestion = new AbortController();
  now.mapKey = "";
  mapTimer = setTimeout(async () => {
    drawWaiting("solving …");
    $("map-state").textContent = "is being solved …";
    now.mapKey = key;
    try {
      now.map = await engine.contrast(message(), question.signal);
      $("map-figure").classList.remove("waiting");
      $("map-state").textContent = `${state.names[state.pair[1]]} minus ${state.names[state.pair[0]]}`;
      $("advice").textContent = `Where to work (◆): ${now.map.recommendation}`;
      drawMap();
    } catch (error) {
      if (error.name === "AbortError") return;
      $("map-state").textContent = "";
      if (error.code === engine.TOO_LONG) { $("advice").textContent = error.message; return; }
      now.mapKey = "";
      complain(error.message);
    }
  }, SETTLED);
}

let linkTimer = 0;
function changed() {
  clearTimeout(linkTimer);
  linkTimer = setTimeout(() => history.replaceState(null, "", toLink()), SETTLED);
  $("scan").hidden = !about.control && state.values["control.kind"] === "engage" && !state.values["realism.line_offset"];
  picture.run();
  curves.overtake(); // they follow the next picture
  askForMap();
}

// ---- drawing

const QUANTITIES = [["height", () => "height (nm)"], ["phase", () => (state.lag ? "phase lag (°)" : "phase (°)")]];
const phaseLabel = QUANTITIES[1][1];
const PLOTS = ["amplitude-curve", "phase-curve", "period", "map"];

/** What is known before the first answer: which material is where, and what is going on. */
function drawWaiting(doing) {
  if (!now.picture) for (const [name] of QUANTITIES) draw.sample($(name), about.labels, about.shape, about.pixel, doing);
  if (!now.curves) for (const id of PLOTS.slice(0, 3)) draw.waiting($(id), now.picture ? doing || "solving …" : "comes after the image");
  if (!now.map) draw.waiting($("map"), now.curves ? "is being solved …" : "comes after the curves");
}

/** A measured map as the page counts it, with its zero where the regions agree best with the simulated ones. */
function measured(name) {
  const shift = now.picture.measured[name];
  return about.measured[name].map(name === "phase" && state.lag ? (value) => 90 - value + shift : (value) => value + shift);
}

/** The maps of a quantity: canvas, values, shape, pixel size and title of the simulated one, and of the measured one. */
function mapsOf(name) {
  const { [name]: values, shape, pixel } = now.picture;
  if (!about.measured) return [{ canvas: $(name), values, shape, pixel, title: "" }];
  return [
    { canvas: $(name), values, shape, pixel, title: "simulated" },
    { canvas: $(`${name}-measured`), values: measured(name), shape: about.shape, pixel: about.pixel, title: "measured" },
  ];
}

function drawImages() {
  const shown = now.picture;
  const [rows] = shown.shape;
  now.row = Math.min(now.row ?? rows >> 1, rows - 1);
  now.maps = Object.fromEntries(QUANTITIES.map(([name]) => [name, mapsOf(name)]));
  const held = { height: draw.limitsOf(now.maps.height), phase: draw.limitsOf(now.maps.phase, LEAST) };
  if (!$("hold").checked || !now.held) now.held = held;
  for (const [name, label] of QUANTITIES) {
    const maps = now.maps[name], range = now.held[name], colours = offer.colours[name], text = label();
    for (const map of maps) {
      const box = now[`${name}Box`] = draw.image(map, range, colours, text); // the same for both
      draw.marker(map.canvas, box, Math.round(box.top + ((now.row + 0.5) / rows) * box.height) + 0.5);
    }
    draw.histogram($(`${name}-histogram`), maps, range, colours, text);
    draw.profile($(`${name}-profile`), maps, (now.row + 0.5) / rows, range, text);
  }
  const warnings = [...shown.warnings, ...(shown.materials ? [] : shown.failed)]; // else the words say it of each material
  $("warnings").replaceChildren(...warnings.map((line) => Object.assign(document.createElement("li"), { textContent: line })));
  const notes = shown.lever ? [shown.lever] : [];
  if (shown.step > 1) notes.push(`Every ${shown.step === 2 ? "second" : `${shown.step}th`} pixel is shown; what is saved has all.`);
  if (!$("scan").hidden) notes.push(shown.materials ? `The tip is lowered onto each pixel anew (no memory of its neighbours)${about.simplified ? `, ${about.simplified}` : ""}.` : "This is the trace of the scan, until a slider moves.", engine.refused.scan ?? "");
  $("note").textContent = notes.join(" ");
}

function drawWords() {
  const why = $("why"), match = now.picture.measured?.says ?? "";
  $("match").textContent = match;
  $("match").hidden = !match;
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
    cells[0].prepend(controls.dot(i));
    cells.at(-1).title = about_solver;
    const row = document.createElement("tr");
    row.append(...cells);
    return [row];
  });
  $("materials").tBodies[0].replaceChildren(...rows);
  $("materials").hidden = false;
}

const ofPair = () => [...new Set(state.pair)].map((i) => ({ data: now.curves[state.names[i]], colour: draw.materialColour(i) })).filter(({ data }) => data);

function drawCurves() {
  if (!now.curves || !ofPair().length) return;
  draw.curve($("amplitude-curve"), ofPair(), "amplitude", "amplitude (nm)");
  draw.curve($("phase-curve"), ofPair(), "phase", phaseLabel());
  draw.period($("period"), ofPair());
}

function drawMap() {
  if (!now.map) return;
  now.axes = draw.contrast($("map"), now.map, offer.colours.contrast, [state.values["scan.setpoint"], state.values["drive.free_amplitude"] * 1e9]);
}

function drawAll() {
  if (!about) return;
  drawWaiting($("state").textContent);
  if (now.picture) drawImages();
  drawCurves();
  drawMap();
}

// ---- the sample

/** Shows a sample, with what a link says of it. */
async function show(name, link = {}) {
  const wanted = now.wanted = {};
  say(`opening ${name} …`);
  const found = await engine.sample(name);
  if (now.wanted !== wanted) return; // another one is
  about = found;
  Object.assign(now, nothing);
  begin(name, about, link);
  document.title = `${about.name} – phasemap`;
  if (![...$("sample").options].some((option) => option.value === name)) $("sample").prepend(new Option(name, name));
  $("sample").value = name;
  $("about").textContent = [offer.samples[name] === "opened" ? "" : offer.samples[name], about.note].filter(Boolean).join(" ");
  for (const id of SWITCHES) $(id).checked = state[id];
  $("warnings").replaceChildren();
  $("why").replaceChildren(Object.assign(document.createElement("p"), { textContent: `Where ${state.names.join(" and ")} are is seen at once; how they look under the tip, and why, is being solved.` }));
  $("materials").hidden = $("match").hidden = true;
  $("pictures").classList.toggle("matched", Boolean(about.measured));
  for (const [name] of QUANTITIES) $(`${name}-measured`).hidden = !about.measured;
  for (const id of ["note", "advice", "map-state"]) $(id).textContent = "";
  $("map-figure").hidden = state.names.length < 2;
  $("scan").title = engine.refused.scan ?? about.control ?? "";
  controls.build($("values"), knobs, offer.presets, () => { showPair(); changed(); });
  showPair();
  complain("");
  drawWaiting("solving …");
  changed();
}

/** The choice of the two materials that are compared, where there are more. */
function showPair() {
  $("pair").hidden = state.names.length < 3;
  ["first", "second"].forEach((id, which) => {
    $(id).replaceChildren(...state.names.map((name, i) => new Option(name, i)));
    $(id).value = state.pair[which];
  });
}

for (const [which, id] of ["first", "second"].entries()) {
  $(id).addEventListener("change", () => {
    state.pair[which] = Number($(id).value);
    if (state.pair[0] === state.pair[1]) state.pair[1 - which] = (state.pair[which] + 1) % state.names.length;
    showPair();
    changed();
  });
}

$("sample").addEventListener("change", () => {
  if ($("sample").value === OPEN) {
    $("sample").value = state.sample;
    $("file").click();
  } else attempt(() => show($("sample").value));
});

$("file").addEventListener("change", () => attempt(async () => {
  const [file] = $("file").files;
  $("file").value = "";
  if (file) await show(await engine.open(file));
}));

/** Does what a click asks for, and says what is wrong. */
async function attempt(work) {
  try {
    await work();
  } catch (error) {
    say("");
    complain(error.message);
  }
}

for (const id of SWITCHES) $(id).addEventListener("change", () => { state[id] = $(id).checked; now.held = null; changed(); });
$("hold").addEventListener("change", drawAll);
$("reset").addEventListener("click", controls.setBack);
$("knobs").addEventListener("submit", (event) => event.preventDefault());

// ---- mouse and buttons

function place(event, canvas, box) {
  const frame = canvas.getBoundingClientRect(), [rows, columns] = now.picture.shape;
  const row = Math.floor(((event.clientY - frame.top - box.top) / box.height) * rows);
  const column = Math.floor(((event.clientX - frame.left - box.left) / box.width) * columns);
  return row >= 0 && row < rows && column >= 0 && column < columns ? [row, column] : null;
}

/** The values of a quantity in a pixel of the picture, simulated and measured. */
function valuesAt(name, [row, column]) {
  const [rows, columns] = now.picture.shape, unit = name === "height" ? "nm" : "°";
  return now.maps[name].map(({ values, shape: [tall, wide], title }) => {
    const value = values[Math.floor(((row + 0.5) * tall) / rows) * wide + Math.floor(((column + 0.5) * wide) / columns)];
    return `${title} ${number(Number.isNaN(value) ? null : value, 4)} ${unit}`.trim();
  }).join(", ");
}

for (const canvas of QUANTITIES.flatMap(([name]) => [$(name), $(`${name}-measured`)])) {
  const name = canvas.id.replace("-measured", "");
  const point = (event) => {
    if (!now.picture) return;
    const at = place(event, canvas, now[`${name}Box`]);
    for (const [other] of QUANTITIES) $(`${other}-here`).textContent = at ? valuesAt(other, at) : "";
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
  state.values["scan.setpoint"] = Math.min(round(x, 3), 0.99);
  state.values["drive.free_amplitude"] = round(y * 1e-9, 3);
  controls.refresh();
  changed();
}
$("map").addEventListener("pointerdown", pointMap);
$("map").addEventListener("pointermove", pointMap);
$("map").title = "Click to use this setting";

/** Does what a button says, which is dead in the meantime. */
function button(id, busy, work) {
  const element = $(id), why = engine.refused[id.replace("-", "/")];
  if (why) Object.assign(element, { disabled: true, title: why });
  element.addEventListener("click", async () => {
    element.disabled = true;
    $("save").open = false;
    say(busy);
    const ticking = setInterval(async () => {
      const doing = await engine.doing(message()).catch(() => "");
      if (element.disabled) say(`${busy} ${doing}`);
    }, PATIENT);
    await attempt(async () => {
      say((await work()) ?? "");
      complain("");
    });
    element.disabled = false;
    clearInterval(ticking);
  });
}

for (const what of ["scene", "image", "picture"]) {
  button(`save-${what}`, `the ${what} is being made …`, async () => {
    const file = await engine.save(what, message());
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([file.content], { type: file.kind }));
    link.download = file.name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    return `saved as ${file.name}`;
  });
}

async function copy(text, said) {
  try {
    await navigator.clipboard.writeText(text);
    return said;
  } catch {
    $("python").querySelector("textarea").value = text;
    $("python").showModal();
    $("python").querySelector("textarea").select();
    return "";
  }
}

button("copy-python", "…", async () => copy(new TextDecoder().decode((await engine.save("python", message())).content), "the Python is on the clipboard"));
button("copy-link", "…", () => copy(address(), "the link is on the clipboard"));

button("scan", "the scan is being simulated …", async () => {
  const began = performance.now();
  take(await engine.scan(message()));
  return `scan in ${((performance.now() - began) / 1000).toFixed(1)} s`;
});

const address = () => location.href.replace(/#.*/, "") + toLink();

// ---- the start

async function startWith(fragment) {
  const link = fromLink(fragment);
  try {
    await show(link.sample ?? offer.first, link);
  } catch (error) {
    if (link.sample === undefined || link.sample === offer.first) throw error;
    await show(offer.first);
    $("about").textContent = error.message; // of what the link names
  }
}

await attempt(async () => {
  [offer, knobs] = await Promise.all([engine.start(), fetch("knobs.json").then((answer) => answer.json())]);
  $("sample").replaceChildren(...Object.entries(offer.samples).map(([name, title]) => Object.assign(new Option(name, name), { title })), Object.assign(new Option(OPEN, OPEN), { disabled: "open" in engine.refused, title: engine.refused.open ?? "" }));
  $("scan").textContent = "Scan as a microscope does";
  await startWith(location.hash);
  window.addEventListener("hashchange", () => { if (location.hash !== toLink()) attempt(() => startWith(location.hash)); });
  new ResizeObserver(() => requestAnimationFrame(drawAll)).observe($("views"));
  new ResizeObserver(() => requestAnimationFrame(drawAll)).observe($("pictures"));
  draw.onColours(() => { for (const [i, dot] of document.querySelectorAll("legend .dot").entries()) dot.style.background = draw.materialColour(i); drawAll(); });
});
engine.watch((gone) => {
  now.gone = false;
  complain(gone ? engine.revival(address()) : "");
  document.body.classList.toggle("stale", gone);
  now.gone = gone;
  if (!gone) changed();
});
