// What the page shows: the sample, the values of its sliders and choices, and the link that holds them.
//
// Values have the keys of a scene, in SI units; materials have numbers for names. "materials.N.loss" is the page's own:
// it says which of the keys of the loss count. "losses" has what it was when the material last relaxed, or last did not.

export const state = { sample: "", start: {}, values: {}, firstNames: [], names: [], pair: [0, 0], exact: false, lag: false, losses: {} };

const LOSSES = { damping: 0, viscosity: null, relaxed_modulus: null, relaxation_time: null, relaxation: null }; // and what each is without
const OF = {
  damping: ["damping"], viscosity: ["viscosity"], relaxation: ["relaxed_modulus", "relaxation_time"], spectrum: ["relaxation"],
};

/** Begins with a sample as the engine describes it, and what a link says of it. */
export function begin(name, { values, materials }, link = {}) {
  state.sample = name;
  state.start = values;
  state.firstNames = materials;
  state.names = link.names?.length === materials.length ? link.names : [...materials];
  const last = materials.length - 1;
  state.pair = link.pair?.every((i) => i >= 0 && i <= last) ? link.pair : [0, Math.min(1, last)];
  state.exact = Boolean(link.exact);
  state.lag = Boolean(link.lag);
  const known = Object.entries(link.changes ?? {}).filter(([key]) => key in values);
  state.values = { ...values, ...Object.fromEntries(known) };
  state.losses = {};
  materials.forEach((_, i) => {
    const value = (key) => state.values[`materials.${i}.${key}`];
    state.values[`materials.${i}.loss`] = value("relaxation") !== null ? "spectrum" : value("relaxation_time") !== null ? "relaxation" : value("viscosity") !== null ? "viscosity" : "damping";
  });
}

/** Everything as it was to begin with. */
export const reset = () => begin(state.sample, { values: state.start, materials: state.firstNames }, { pair: state.pair, exact: state.exact, lag: state.lag });

const OF_FEEDBACK = { "control.line_rate": undefined, "control.bandwidth": undefined, "realism.temperature": null, "realism.detector_noise": null };

/** The values that count: of each material one loss only, and what acts in time where time passes. */
function effective() {
  const values = {}, still = state.values["control.kind"] !== "feedback";
  for (const [key, value] of Object.entries(state.values)) {
    if (still && key in OF_FEEDBACK) {
      if (OF_FEEDBACK[key] === null) values[key] = null;
      continue;
    }
    if (key === "drive.second.free_amplitude" && state.values["cantilever.modes"] === 1) { // which has none to drive
      values[key] = null;
      continue;
    }
    const [, i, name] = key.match(/^materials\.(\d+)\.(.*)$/) ?? [];
    if (name === "loss") continue;
    values[key] = name in LOSSES && !OF[state.values[`materials.${i}.loss`]].includes(name) ? LOSSES[name] : value;
  }
  return values;
}

/** What differs from the sample. */
export function changes() {
  return Object.fromEntries(Object.entries(effective()).filter(([key, value]) => value !== state.start[key]));
}

/** What the engine is asked. */
export function message() {
  return { sample: state.sample, changes: changes(), names: state.names, pair: state.pair, exact: state.exact, lag: state.lag };
}

/** The fragment of the page's address. */
export function toLink() {
  const parts = [["sample", state.sample], ...Object.entries(changes()).map(([key, value]) => [key, value ?? "none"])];
  const text = parts.map(([key, value]) => `${key}=${encodeURIComponent(value)}`);
  if (state.names.some((name, i) => name !== state.firstNames[i])) text.push(`names=${state.names.map(encodeURIComponent).join(",")}`);
  if (state.pair[0] !== 0 || state.pair[1] !== Math.min(1, state.names.length - 1)) text.push(`pair=${state.pair.join(",")}`);
  for (const name of ["exact", "lag"]) if (state[name]) text.push(`${name}=true`);
  return `#${text.join("&")}`;
}

/** What a fragment says: sample, changes, names, pair, exact and lag. */
export function fromLink(fragment) {
  const said = { changes: {} };
  for (const part of fragment.replace(/^#/, "").split("&").filter(Boolean)) {
    const at = part.indexOf("="), key = part.slice(0, at), text = part.slice(at + 1);
    if (key === "names") said.names = text.split(",").map(decodeURIComponent);
    else if (key === "pair") said.pair = text.split(",").map(Number);
    else if (key === "exact" || key === "lag") said[key] = text === "true";
    else if (key === "sample") said.sample = decodeURIComponent(text);
    else {
      const value = decodeURIComponent(text);
      said.changes[key] = value === "none" ? null : value.trim() !== "" && isFinite(value) ? Number(value) : value;
    }
  }
  return said;
}
