// The form on the left: a slider or a choice for every value, those that matter first and the others folded away.

import { changes, reset, state } from "./state.js";
import { materialColour } from "./draw.js";
import { refused } from "./engine.js";

const STEPS = 1000;
const PEAKS = 5; // half widths of the resonance that the slider of the frequency reaches
const FOLDED = ["lever and drive", "forces", "scan", "more of the material"];
const round = (value, digits) => Number(value.toPrecision(digits));
const close = (a, b) => a === b || (typeof a === "number" && typeof b === "number" && Math.abs(a - b) <= 1e-9 * Math.abs(b));
const make = (tag, properties, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};

let controls = []; // { key, refresh } of every slider and choice
let notify = () => {};

/** Builds the form: knobs as knobs.json declares them, presets as the engine has them; `changed` is called by each. */
export function build(form, knobs, presets, changed) {
  notify = changed;
  controls = [];
  const sets = [], of = (group, i) => knobs.filter((knob) => knob.group === group).map((knob) => control(knob, i, presets));
  sets.push(make("fieldset", {}, make("legend", { textContent: "Microscope" }), ...of("microscope", null)));
  state.names.forEach((_, i) => sets.push(make(
    "fieldset", {}, make("legend", {}, dot(i), named(i)), ...of("material", i), fold("more of the material", of("more of the material", i)),
  )));
  for (const group of FOLDED.slice(0, -1)) sets.push(fold(group, of(group, null)));
  form.replaceChildren(...sets);
  refresh();
}

/** Shows the values of the state. */
export function refresh() {
  for (const { refresh } of controls) refresh();
}

/** A mark in the colour of a material. */
export function dot(i) {
  const mark = make("span", { className: "dot" });
  mark.style.background = materialColour(i);
  return mark;
}

function fold(title, content) {
  const count = make("span", { className: "note" }), of = content.map((one) => one.dataset.key);
  const folded = make("details", {}, make("summary", {}, title[0].toUpperCase() + title.slice(1), count), ...content);
  controls.push({ refresh: () => {
    const many = Object.keys(changes()).filter((key) => of.includes(key)).length;
    count.textContent = many ? ` ${many} changed` : "";
    folded.hidden = content.every((one) => one.hidden);
  } });
  return folded;
}

function named(i) {
  const input = make("input", { className: "name", type: "text", value: state.names[i], title: "Click to rename", spellcheck: false });
  input.setAttribute("aria-label", `name of material ${i + 1}`);
  input.addEventListener("change", () => { rename(i, input.value); notify(); });
  controls.push({ refresh: () => { input.value = state.names[i]; } });
  return input;
}

/** Gives a material a name that no other has. */
function rename(i, wanted) {
  let name = wanted.trim() || state.firstNames[i];
  for (let count = 2; state.names.some((other, j) => j !== i && other === name); count++) name = `${wanted.trim()} ${count}`;
  state.names[i] = name;
}

const keyOf = (key, i) => key.replace("*", i);

function control(knob, i, presets) {
  const key = keyOf(knob.key, i);
  const row = knob.presets ? preset(knob, i, presets[knob.presets]) : knob.choices ? choice(knob, key) : slider(knob, key);
  row.dataset.key = key;
  if (knob.if) controls.push({ refresh: () => {
    row.hidden = !Object.entries(knob.if).every(([other, values]) => values.includes(state.values[keyOf(other, i)]));
  } });
  return row;
}

function set(key, value) {
  if (key.endsWith(".loss")) translateLoss(key, value);
  if (key === "control.kind" && value === "feedback") beginFeedback();
  if (key === "cantilever.environment" && value === "water") beginWater();
  state.values[key] = value;
  refresh();
  notify();
}

/** A feedback begins as on an ordinary instrument, with noise. */
function beginFeedback() {
  const usual = { "control.line_rate": 2, "control.bandwidth": 1000, "realism.temperature": 295, "realism.detector_noise": 100e-15 };
  for (const [key, value] of Object.entries(usual)) state.values[key] ??= value;
}

/** In water the size of a lever counts, and so do two modes; it is driven at the resonance that it has there. */
function beginWater() {
  const { values } = state;
  values["cantilever.length"] ??= 125e-6;
  values["cantilever.width"] ??= 30e-6;
  values["cantilever.modes"] = Math.max(values["cantilever.modes"], 2);
  values["drive.frequency"] = null;
}

/** The loss of a material in another form, of the same size where that is known: alpha1 = eta R omega_c / (2 k). */
function translateLoss(key, kind) {
  const at = (name) => key.replace("loss", name), { values } = state, was = values[key];
  const factor = (values["tip.radius"] * 2 * Math.PI * values["cantilever.resonance_frequency"]) / (2 * values["cantilever.stiffness"]);
  if (kind === "viscosity") values[at("viscosity")] = was === "damping" ? round(values[at("damping")] / factor, 3) : values[at("viscosity")] ?? 0;
  if (kind === "damping" && was === "viscosity") values[at("damping")] = round((values[at("viscosity")] ?? 0) * factor, 3);
  if (kind === "relaxation") {
    values[at("relaxed_modulus")] ??= round(0.5 * values[at("modulus")], 3);
    values[at("relaxation_time")] ??= 1e-6;
  }
  if (kind === "spectrum") values[at("relaxation")] ??= "PIB";
  lossesAlike(key, kind);
}

const relaxes = (kind) => kind === "relaxation" || kind === "spectrum";
const kindIn = (values) => ("relaxation_time" in values ? "relaxation" : "viscosity" in values ? "viscosity" : "damping");

/** On one surface all materials relax, or none: the others follow, as they last did that, at first without a loss. */
function lossesAlike(key, kind) {
  const { values } = state;
  state.names.forEach((_, i) => {
    const one = `materials.${i}.loss`, at = (name) => one.replace("loss", name), was = values[one];
    if (relaxes(was) === relaxes(kind)) return;
    const lossless = was === "relaxation" && values[at("relaxed_modulus")] === values[at("modulus")];
    const before = state.losses[one];
    state.losses[one] = lossless ? undefined : was;
    if (one === key) return;
    values[one] = before ?? (relaxes(kind) ? "relaxation" : kind);
    if (!relaxes(kind)) values[at(values[one])] ??= 0;
    else if (!before) [values[at("relaxed_modulus")], values[at("relaxation_time")]] = [values[at("modulus")], 1e-6];
  });
}

function row(label, id, ...children) {
  return make("div", { className: "knob" }, make("label", { textContent: label, htmlFor: id }), ...children);
}

function choice(knob, key) {
  const option = ([value, text]) => {
    const title = refused[`${knob.key}=${value}`];
    return title ? make("option", { value, textContent: `${text}: phasemap explore`, title, disabled: true }) : new Option(text, value);
  };
  const select = make("select", { id: key }, ...Object.entries(knob.choices).map(option));
  select.addEventListener("change", () => set(key, typeof state.start[key] === "number" ? Number(select.value) : select.value));
  controls.push({ refresh: () => {
    const value = String(state.values[key]);
    if (![...select.options].some((option) => option.value === value)) select.append(new Option(value, value)); // a law of one's own
    select.value = value;
  } });
  return row(knob.label, key, select);
}

/** Options in groups of their kind. */
function grouped(presets, option) {
  const kinds = new Map(presets.map(({ kind }) => [kind, make("optgroup", { label: kind })]));
  for (const preset of presets) kinds.get(preset.kind).append(option(preset));
  return kinds.values();
}

/** A choice of presets; those of a material name it too. */
function preset(knob, i, presets) {
  const prefix = knob.key.replace("*", i).replace("preset", ""), id = keyOf(knob.key, i);
  const select = make("select", { id, className: "wide" }, new Option(`${knob.label}: own values, or choose …`, ""), ...grouped(presets, ({ name, title }) => new Option(i === null ? title : `${name} – ${title}`, name)));
  const known = ({ values }) => Object.entries(values).filter(([name]) => prefix + name in state.start);
  select.addEventListener("change", () => {
    const found = presets.find(({ name }) => name === select.value);
    if (!found) { refresh(); return; }
    if (i !== null) {
      const loss = `${prefix}loss`, kind = kindIn(found.values);
      lossesAlike(loss, kind);
      state.values[loss] = kind;
      rename(i, found.name);
    }
    for (const [name, value] of known(found)) state.values[prefix + name] = value;
    refresh();
    notify();
  });
  controls.push({ refresh: () => {
    const counts = ({ values }) => i === null || kindIn(values) === state.values[`${prefix}loss`];
    const same = presets.find((one) => counts(one) && known(one).every(([name, value]) => close(state.values[prefix + name], value)));
    select.value = same?.name ?? "";
  } });
  return row(knob.label, id, select);
}

/** The ends of a slider: those of the drive's frequency are on both sides of the resonance. */
function ends(knob) {
  if (knob.scale !== "resonance") return knob;
  const resonance = state.values["cantilever.resonance_frequency"], value = state.values["drive.frequency"] ?? resonance;
  const off = Math.max(Math.min((0.5 * PEAKS) / state.values["cantilever.quality_factor"], 0.6), 1.5 * Math.abs(value / resonance - 1));
  return { low: Math.max(1 - off, (0.1 * value) / resonance) * resonance, high: (1 + off) * resonance, usual: resonance };
}

function toSlider(knob, value) {
  const { low, high } = ends(knob);
  if (knob.scale === "log") return STEPS * (Math.log(value / low) / Math.log(high / low));
  return STEPS * (knob.scale === "cubic" ? Math.cbrt(value / high) : (value - low) / (high - low));
}

function fromSlider(knob, at) {
  const { low, high } = ends(knob), part = at / STEPS;
  if (knob.scale === "log") return round(low * (high / low) ** part, 3);
  if (knob.scale === "cubic") return round(high * part ** 3, 3);
  return round(low + (high - low) * part, knob.scale === "resonance" ? 7 : 3);
}

function slider(knob, key) {
  const size = knob.size ?? 1, digits = knob.scale === "resonance" ? 8 : 5;
  const typed = make("input", { type: "number", step: "any", id: key });
  const range = make("input", { type: "range", min: 0, max: STEPS, step: "any", title: "Double-click to set it back" });
  range.setAttribute("aria-label", knob.label);
  const parts = row(knob.label, key, typed, make("span", { className: "unit", textContent: knob.unit }), range);
  let held = false;
  const move = (value) => { state.values[key] = value; refresh(); notify(); };
  range.addEventListener("input", () => { held = true; move(fromSlider(knob, Number(range.value))); held = false; });
  typed.addEventListener("change", () => { if (typed.value === "") refresh(); else move(round(Number(typed.value) * size, 12)); });
  for (const one of [parts.firstChild, range]) one.addEventListener("dblclick", () => move(state.start[key]));
  const none = knob.none && make("input", { type: "checkbox" });
  if (none) {
    none.addEventListener("change", () => move(none.checked ? null : ends(knob).usual));
    parts.append(make("label", { className: "none" }, none, knob.none));
  }
  controls.push({ refresh: () => {
    const value = state.values[key], absent = value === null || value === undefined;
    if (none) none.checked = absent;
    typed.disabled = range.disabled = absent;
    typed.value = absent ? "" : round(value / size, digits);
    if (!held && !absent) range.value = toSlider(knob, value); // a slider that is held does not jump
  } });
  return parts;
}

/** Sets everything back. */
export function setBack() {
  reset();
  refresh();
  notify();
}
