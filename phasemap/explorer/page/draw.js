// Drawing on canvases: images with colour bars, curves with axes, maps.

const FAILED = [0, 230, 70];
const COLOURS = { // of materials, on light and dark paper
  light: ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#56b4e9", "#7a4b2a", "#555555"],
  dark: ["#4db2ef", "#ff9147", "#2fd3a6", "#e9a3c9", "#e0b040", "#9bd5f7", "#c79a78", "#b5b5b5"],
};
const dark = window.matchMedia("(prefers-color-scheme: dark)");
const FONT = '11.5px system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif';

let INK, QUIET, GRID, EDGE, PAPER, MEASURED; // as the style sheet has them
function readColours() {
  const style = getComputedStyle(document.documentElement);
  [INK, QUIET, GRID, EDGE, PAPER, MEASURED] = ["ink", "quiet", "grid", "edge", "paper", "accent"].map((name) => style.getPropertyValue(`--${name}`).trim());
}
readColours();

/** Calls `then` when the screen becomes light or dark. */
export function onColours(then) {
  dark.addEventListener("change", () => { readColours(); then(); });
}

/** The colour of a material. */
export const materialColour = (i) => COLOURS[dark.matches ? "dark" : "light"][i];

/** Pixels beside an image, for its colour bar, which has no label where there is little room. */
const barOf = (canvas) => (canvas.clientWidth < 240 ? 44 : 74);

/** The context of a canvas that is as sharp as the screen, in units of CSS pixels, cleared. */
export function paper(canvas) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = FONT;
  pen.lineJoin = "round";
  return { pen, width, height };
}

/** Round values between two ends, about so many. */
export function ticks(low, high, count) {
  const rough = (high - low) / Math.max(count, 1);
  if (!(rough > 0) || !isFinite(rough)) return [low];
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((one) => one >= rough * 0.999);
  const values = [];
  for (let i = Math.ceil(low / step - 1e-9); i <= Math.floor(high / step + 1e-9); i++) values.push(i * step);
  return values;
}

const shown = (value) => {
  const text = String(Number(value.toPrecision(4)));
  return text.replace("-", "−");
};

/** Axes in a rectangle of the canvas; `x` and `y` turn values into pixels. */
export class Axes {
  constructor(pen, box, xlim, ylim, { xlabel = "", ylabel = "", logarithmic = false, xticks = null, bare = false, right = false } = {}) {
    Object.assign(this, { pen, box, xlim, ylim });
    const map = logarithmic ? Math.log : (value) => value;
    const [x0, x1] = xlim, [y0, y1] = ylim.map(map);
    this.x = (value) => box.left + ((value - x0) / (x1 - x0 || 1)) * box.width;
    this.y = (value) => box.top + box.height - ((map(value) - y0) / (y1 - y0 || 1)) * box.height;
    this.atX = (pixel) => x0 + ((pixel - box.left) / box.width) * (x1 - x0);
    this.atY = (pixel) => {
      const value = y0 + ((box.top + box.height - pixel) / box.height) * (y1 - y0);
      return logarithmic ? Math.exp(value) : value;
    };
    pen.lineWidth = 1;
    pen.strokeStyle = GRID;
    pen.fillStyle = QUIET;
    pen.textAlign = "center";
    pen.textBaseline = "top";
    const bottom = box.top + box.height;
    for (const value of xticks ?? ticks(x0, x1, box.width / 40)) {
      const at = Math.round(this.x(value)) + 0.5;
      if (!bare) this.stroke([[at, box.top], [at, bottom]]);
      else this.stroke([[at, bottom], [at, bottom + 3]]);
      const text = shown(value), half = pen.measureText(text).width / 2;
      if (xlabel) pen.fillText(text, Math.max(at, half), bottom + 4);
    }
    pen.textAlign = right ? "left" : "right";
    pen.textBaseline = "middle";
    const beside = right ? box.left + box.width + 5 : box.left - 4;
    const marks = logarithmic ? [1, 2, 5, 10, 20, 50, 100, 200, 500].filter((v) => v >= ylim[0] && v <= ylim[1])
      : ticks(ylim[0], ylim[1], box.height / 22);
    for (const value of bare ? [] : marks) {
      const at = Math.round(this.y(value)) + 0.5;
      this.stroke([[box.left, at], [box.left + box.width, at]]);
      pen.fillText(shown(value), beside, at);
    }
    pen.strokeStyle = EDGE;
    this.stroke([[box.left + 0.5, bare ? bottom + 0.5 : box.top], [box.left + 0.5, bottom + 0.5], [box.left + box.width, bottom + 0.5]]);
    pen.fillStyle = INK;
    pen.textAlign = "center";
    if (xlabel) {
      pen.textBaseline = "alphabetic";
      pen.fillText(xlabel, box.left + box.width / 2, bottom + 29);
    }
    if (ylabel) {
      pen.save();
      pen.translate(right ? box.left + box.width + 62 : box.left - 37, box.top + box.height / 2);
      pen.rotate(-Math.PI / 2);
      pen.textBaseline = "middle";
      pen.fillText(ylabel, 0, 0);
      pen.restore();
    }
  }

  /** A line of pixels. */
  stroke(points) {
    this.pen.beginPath();
    for (const [x, y] of points) this.pen.lineTo(x, y);
    this.pen.stroke();
  }

  /** A curve of values, cut off at the axes; null breaks it. */
  line(xs, ys, colour, width = 1.6, dash = []) {
    const { pen, box } = this;
    pen.save();
    pen.beginPath();
    pen.rect(box.left, box.top - 2, box.width, box.height + 4);
    pen.clip();
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.setLineDash(dash);
    pen.beginPath();
    let down = false;
    for (let i = 0; i < xs.length; i++) {
      if (xs[i] === null || ys[i] === null || !isFinite(ys[i])) { down = false; continue; }
      const x = this.x(xs[i]), y = this.y(ys[i]);
      if (down) pen.lineTo(x, y); else pen.moveTo(x, y);
      down = true;
    }
    pen.stroke();
    pen.restore();
  }

  /** The working point. */
  ring(x, y, colour, radius = 5) {
    const { pen } = this;
    pen.beginPath();
    pen.arc(this.x(x), this.y(y), radius, 0, 2 * Math.PI);
    pen.fillStyle = PAPER;
    pen.fill();
    pen.lineWidth = 2.2;
    pen.strokeStyle = colour;
    pen.stroke();
  }

  /** The point that is recommended. */
  diamond(x, y) {
    const { pen } = this, [left, top] = [this.x(x), this.y(y)];
    pen.beginPath();
    for (const [dx, dy] of [[0, -6], [6, 0], [0, 6], [-6, 0]]) pen.lineTo(left + dx, top + dy);
    pen.closePath();
    pen.fillStyle = "#ffd400";
    pen.fill();
    pen.lineWidth = 1.2;
    pen.strokeStyle = INK;
    pen.stroke();
  }

  /** An arrow straight from one height to another. */
  jump(x, from, to, colour) {
    const { pen } = this;
    const at = this.x(x), y0 = this.y(from), y1 = this.y(to), sign = Math.sign(y1 - y0);
    if (Math.abs(y1 - y0) < 3) return;
    this.line([x, x], [from, to], colour, 1, [3, 2]);
    if (Math.abs(y1 - y0) < 10) return;
    pen.beginPath();
    pen.moveTo(at, y1);
    pen.lineTo(at - 3, y1 - 7 * sign);
    pen.lineTo(at + 3, y1 - 7 * sign);
    pen.closePath();
    pen.fillStyle = colour;
    pen.fill();
  }
}

/** The limits that suit several maps. */
export function limitsOf(maps, span) {
  const every = maps.map(({ values }) => limits(values, span));
  return [Math.min(...every.map(([low]) => low)), Math.max(...every.map(([, high]) => high))];
}

/** The limits that are shown: the 0.5 and 99.5 percentiles, with a little room, and `span` apart at least. */
function limits(values, span = 0) {
  let least = Infinity, most = -Infinity, count = 0;
  for (let i = 0; i < values.length; i++) {
    const value = values[i];
    if (value !== value) continue;
    count++;
    if (value < least) least = value;
    if (value > most) most = value;
  }
  if (!count) return [0, 1];
  const bins = new Uint32Array(2048), scale = (bins.length - 1e-6) / (most - least || 1);
  for (let i = 0; i < values.length; i++) if (values[i] === values[i]) bins[(values[i] - least) * scale | 0]++;
  const percentile = (share) => {
    let seen = 0, bin = 0;
    while (bin < bins.length - 1 && (seen += bins[bin]) < share * count) bin++;
    return bin;
  };
  let low = least + percentile(0.005) / scale, high = least + (percentile(0.995) + 1) / scale;
  if (high - low < 2 / scale) [low, high] = [least, most]; // a few particles on a flat ground
  const room = Math.max(high - low > 1e-6 ? 0.04 * (high - low) : 0.5, (span - (high - low)) / 2);
  return [low - room, high + room];
}

/** A map of values as an image with title, colour bar and scale bar; returns where on the canvas it is. */
export function image({ canvas, values, shape: [rows, columns], pixel: [dy, dx], title }, [low, high], colours, unit) {
  const across = canvas.clientWidth - barOf(canvas), tall = Math.min((across * rows * dy) / (columns * dx), 1.4 * across);
  canvas.style.height = `${Math.round(Math.max(tall, 60)) + 8}px`;
  const { pen } = paper(canvas);
  const box = { left: 0, top: 4, width: across, height: Math.max(tall, 60) };
  const pixels = new ImageData(columns, rows), data = pixels.data, scale = 255.999 / (high - low || 1);
  for (let i = 0, j = 0; i < values.length; i++, j += 4) {
    const value = values[i];
    if (value === value) {
      const at = 3 * Math.max(0, Math.min(255, Math.floor((value - low) * scale)));
      data[j] = colours[at]; data[j + 1] = colours[at + 1]; data[j + 2] = colours[at + 2];
    } else [data[j], data[j + 1], data[j + 2]] = FAILED;
    data[j + 3] = 255;
  }
  pen.imageSmoothingEnabled = columns > across;
  pen.drawImage(bitmap(canvas, pixels), box.left, box.top, box.width, box.height);
  colourBar(pen, { left: across + 6, top: 4, width: 11, height: box.height }, [low, high], colours, unit, across < 200);
  scaleBar(pen, box, columns * dx);
  if (title) heading(pen, box, title);
  return box;
}

/** Which material is where, faint, under a sentence: what is known before anything is solved. */
export function sample(canvas, labels, [rows, columns], [dy, dx], sentence) {
  const across = canvas.clientWidth - barOf(canvas), tall = Math.max(Math.min((across * rows * dy) / (columns * dx), 1.4 * across), 60);
  canvas.style.height = `${Math.round(tall) + 8}px`;
  const { pen } = paper(canvas), pixels = new ImageData(columns, rows);
  const colours = Array.from({ length: 8 }, (_, i) => [1, 3, 5].map((at) => parseInt(materialColour(i).slice(at, at + 2), 16)));
  labels.forEach((label, i) => pixels.data.set([...colours[label], 90], 4 * i));
  pen.imageSmoothingEnabled = columns > across;
  pen.drawImage(bitmap(canvas, pixels), 0, 4, across, tall);
  write(pen, sentence, { left: 0, top: 4, width: across, height: tall });
}

/** A sentence where nothing is known yet. */
export function waiting(canvas, sentence) {
  const { pen, width, height } = paper(canvas);
  pen.strokeStyle = GRID;
  pen.setLineDash([4, 4]);
  pen.strokeRect(0.5, 0.5, width - 1, height - 1);
  pen.setLineDash([]);
  write(pen, sentence, { left: 0, top: 0, width, height });
}

/** A sentence in the middle of a box, in as many lines as it needs. */
function write(pen, sentence, box) {
  const lines = [""];
  for (const word of sentence.split(" ")) {
    const longer = `${lines.at(-1)} ${word}`.trim();
    if (lines.at(-1) && pen.measureText(longer).width > box.width - 24) lines.push(word);
    else lines[lines.length - 1] = longer;
  }
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  const tall = 17, top = box.top + (box.height - tall * lines.length) / 2, middle = box.left + box.width / 2;
  const wide = Math.max(...lines.map((line) => pen.measureText(line).width)) + 16;
  pen.globalAlpha = 0.85;
  pen.fillStyle = PAPER;
  pen.fillRect(middle - wide / 2, top - 6, wide, tall * lines.length + 12);
  pen.globalAlpha = 1;
  pen.fillStyle = INK;
  lines.forEach((line, i) => pen.fillText(line, middle, top + tall * (i + 0.5)));
}

/** An image that can be drawn at any size; the canvas keeps its own. */
function bitmap(canvas, pixels) {
  canvas.hidden_ ??= document.createElement("canvas");
  canvas.hidden_.width = pixels.width;
  canvas.hidden_.height = pixels.height;
  canvas.hidden_.getContext("2d").putImageData(pixels, 0, 0);
  return canvas.hidden_;
}

function colourBar(pen, box, [low, high], colours, unit, bare = false) {
  const steps = Math.max(1, Math.round(box.height));
  for (let i = 0; i < steps; i++) {
    const at = 3 * Math.floor((255.999 * (steps - 1 - i)) / Math.max(steps - 1, 1));
    pen.fillStyle = `rgb(${colours[at]},${colours[at + 1]},${colours[at + 2]})`;
    pen.fillRect(box.left, box.top + i, box.width, 1.5);
  }
  pen.fillStyle = INK;
  pen.textAlign = "left";
  pen.textBaseline = "middle";
  const y = (value) => box.top + box.height * (1 - (value - low) / (high - low || 1));
  for (const value of ticks(low, high, box.height / 45)) {
    pen.fillRect(box.left + box.width, y(value) - 0.5, 3, 1);
    pen.fillText(shown(value), box.left + box.width + 5, Math.max(box.top + 5, Math.min(box.top + box.height - 5, y(value))));
  }
  if (bare) return;
  pen.save();
  pen.translate(box.left + box.width + 51, box.top + box.height / 2);
  pen.rotate(-Math.PI / 2);
  pen.textAlign = "center";
  pen.fillText(unit, 0, 0);
  pen.restore();
}

function scaleBar(pen, box, metres) {
  const length = [1, 2, 5].flatMap((digit) => Array.from({ length: 12 }, (_, i) => digit * 10 ** (i - 11)))
    .filter((one) => one <= 0.3 * metres).reduce((best, one) => Math.max(best, one), 0);
  if (!length) return;
  const width = (box.width * length) / metres, left = box.left + 10, top = box.top + box.height - 14;
  const text = length >= 0.999e-6 ? `${shown(length * 1e6)} µm` : `${shown(length * 1e9)} nm`;
  pen.fillStyle = "rgba(0,0,0,0.55)";
  pen.fillRect(left - 5, top - 16, Math.max(width, pen.measureText(text).width) + 10, 25);
  pen.fillStyle = "#fff";
  pen.fillRect(left, top + 2, width, 3);
  pen.textAlign = "left";
  pen.textBaseline = "alphabetic";
  pen.fillText(text, left, top - 3);
}

/** What an image is, in its upper left corner. */
function heading(pen, box, title) {
  pen.fillStyle = "rgba(0,0,0,0.55)";
  pen.fillRect(box.left + 5, box.top + 5, pen.measureText(title).width + 10, 19);
  pen.fillStyle = "#fff";
  pen.textAlign = "left";
  pen.textBaseline = "middle";
  pen.fillText(title, box.left + 10, box.top + 15);
}

/** The line whose profile is shown. */
export function marker(canvas, box, y) {
  const pen = canvas.getContext("2d");
  for (const [colour, offset] of [["#fff", 0], ["#000", 5]]) {
    pen.strokeStyle = colour;
    pen.lineWidth = 1;
    pen.setLineDash([5, 5]);
    pen.lineDashOffset = offset;
    pen.beginPath();
    pen.moveTo(box.left, y);
    pen.lineTo(box.left + box.width, y);
    pen.stroke();
  }
  pen.setLineDash([]);
}

/** How often values are in each of 100 bins, over the most in one. */
function sharesOf({ values }, low, scale) {
  const bins = new Float64Array(100);
  for (const value of values) {
    const bin = Math.floor((value - low) * scale);
    if (bin >= 0 && bin < 100) bins[bin]++;
  }
  const most = Math.max(...bins) || 1;
  return bins.map((count) => count / most);
}

/** How often each value occurs, in the colours of the image; of a measured map, if there is one, as a line. */
export function histogram(canvas, [simulated, measured], [low, high], colours, label) {
  const { pen, width, height } = paper(canvas);
  const scale = 100 / (high - low || 1), bins = sharesOf(simulated, low, scale);
  const box = { left: 0, top: 3, width: width - barOf(canvas), height: height - 37 };
  const axes = new Axes(pen, box, [low, high], [0, 1], { xlabel: label, bare: true });
  for (let i = 0; i < 100; i++) {
    if (!bins[i]) continue;
    const at = 3 * Math.floor(2.56 * (i + 0.5)), tall = Math.max(1.5, box.height * bins[i]);
    pen.fillStyle = `rgb(${colours[at]},${colours[at + 1]},${colours[at + 2]})`;
    pen.strokeStyle = "rgba(0,0,0,0.45)";
    pen.lineWidth = 0.5;
    const x = axes.x(low + i / scale);
    pen.fillRect(x, box.top + box.height - tall, box.width / 100, tall);
    pen.strokeRect(x, box.top + box.height - tall, box.width / 100, tall);
  }
  if (!measured) return;
  const edges = Array.from({ length: 200 }, (_, i) => low + ((i + 1) >> 1) / scale);
  axes.line(edges, Array.from(sharesOf(measured, low, scale)).flatMap((share) => [share, share]), MEASURED, 1.3);
}

/** Values along the row at a share of the height of an image; of a measured map, if there is one, as a second line. */
export function profile(canvas, maps, share, [low, high], label) {
  const { pen, width, height } = paper(canvas);
  const [{ shape: [, columns], pixel: [, dx] }] = maps;
  const box = { left: 0, top: 6, width: width - barOf(canvas), height: height - 41 };
  const micro = columns * dx >= 2e-6, unit = micro ? 1e-6 : 1e-9;
  const axes = new Axes(pen, box, [0, (columns * dx) / unit], [low, high], { xlabel: `along the dashed line (${micro ? "µm" : "nm"})`, ylabel: label, right: true });
  maps.forEach(({ values, shape: [rows, columns], pixel: [, dx] }, which) => {
    const row = Math.floor(share * rows), xs = Array.from({ length: columns }, (_, i) => ((i + 0.5) * dx) / unit);
    axes.line(xs, Array.from(values.subarray(row * columns, (row + 1) * columns)), which ? MEASURED : INK, 1.2);
  });
}

/** A curve with all its branches against the distance: stable ones drawn through, unstable ones dotted. */
export function curve(canvas, materials, quantity, label) {
  const { pen, width, height } = paper(canvas);
  const box = { left: 46, top: 6, width: width - 56, height: height - 44 };
  const which = quantity === "amplitude" ? 0 : 1;
  const points = materials.filter(({ data }) => data.point).map(({ data }) => data.point[1 + which]);
  const every = points.concat(...materials.map(({ data }) => data[quantity].filter((value) => value !== null)));
  const left = Math.min(...materials.map(({ data }) => data.range[0])), right = Math.max(...materials.map(({ data }) => data.range[1]));
  let [low, high] = [Math.min(0, ...every), Math.max(0, ...every)];
  const room = 0.06 * (high - low || 1);
  const ylim = [low < 0 ? low - room : 0, high + room];
  const axes = new Axes(pen, box, [left, right], ylim, { xlabel: "tip–sample distance (nm)", ylabel: label });
  for (const { data, colour } of materials) {
    let start = 0;
    for (let i = 1; i <= data.distance.length; i++) {
      const ends = i === data.distance.length || data.piece[i] !== data.piece[i - 1];
      if (!ends && data.stable[i] === data.stable[i - 1]) continue;
      const stop = ends ? i : i + 1; // joined to what follows
      const style = data.stable[i - 1] ? [1.8, []] : [1.2, [1.5, 3]];
      axes.line(data.distance.slice(start, stop), data[quantity].slice(start, stop), colour, ...style);
      start = i;
    }
    data.jump_distance.forEach((x, i) => {
      const [from, to] = [data.jumps[0][which][i], data.jumps[1][which][i]];
      if (x !== null && from !== null && to !== null) axes.jump(x, from, to, colour);
    });
  }
  for (const { data, colour } of materials) {
    if (data.point) axes.ring(data.point[0], data.point[1 + which], colour);
  }
}

/** Deflection and force over one period of the drive. */
export function period(canvas, materials) {
  const { pen, width, height } = paper(canvas);
  const there = materials.filter(({ data }) => data.period);
  const tall = (height - 60) / 2;
  if (!there.length) {
    pen.fillStyle = QUIET;
    pen.textAlign = "center";
    pen.fillText("The tip is on no periodic orbit here.", width / 2, height / 2);
    return;
  }
  [["deflection", "deflection (nm)"], ["force", "force (nN)"]].forEach(([name, label], i) => {
    const box = { left: 46, top: 6 + i * (tall + 14), width: width - 60, height: tall };
    const every = there.flatMap(({ data }) => data.period[name].filter((value) => value !== null));
    const low = Math.min(0, ...every), high = Math.max(0, ...every), room = 0.06 * (high - low || 1);
    const xlabel = i ? "phase of the drive (°)" : "";
    const axes = new Axes(pen, box, [0, 360], [low - room, high + room], { xlabel, ylabel: label, xticks: [0, 90, 180, 270, 360] });
    axes.line([0, 360], [0, 0], EDGE, 1);
    for (const { data, colour } of there) {
      const values = data.period[name], count = values.length;
      const xs = Array.from({ length: count + 1 }, (_, k) => (360 * k) / count);
      if (name === "deflection") axes.line([0, 360], [data.period.surface, data.period.surface], colour, 1, [4, 3]);
      axes.line(xs, [...values, values[0]], colour, 1.6);
    }
  });
}

/** The contrast against setpoint and free amplitude, with the working point; returns its axes. */
export function contrast(canvas, data, colours, point) {
  const { pen, width, height } = paper(canvas);
  const box = { left: 46, top: 6, width: width - 46 - barOf(canvas), height: height - 44 };
  const every = data.contrast.flat().filter((value) => value !== null).map(Math.abs);
  const reach = Math.max(1, ...every), nx = data.setpoints.length, ny = data.amplitudes.length;
  const half = (values, log) => {
    const [a, b] = [values[0], values[1]], [y, z] = values.slice(-2);
    return log ? [a / Math.sqrt(b / a), z * Math.sqrt(z / y)] : [a - (b - a) / 2, z + (z - y) / 2];
  };
  const xlim = half(data.setpoints), ylim = half(data.amplitudes, true);
  const axes = new Axes(pen, box, xlim, ylim, { xlabel: "setpoint (of free)", ylabel: "free amplitude (nm)", logarithmic: true });
  const pixels = new ImageData(nx, ny);
  data.contrast.forEach((row, i) => row.forEach((value, k) => {
    const j = 4 * ((ny - 1 - i) * nx + k);
    if (value === null) pixels.data.set([...FAILED, 255], j);
    else {
      const at = 3 * Math.max(0, Math.min(255, Math.floor(128 + (127.999 * value) / reach)));
      pixels.data.set([colours[at], colours[at + 1], colours[at + 2], 255], j);
    }
  }));
  pen.imageSmoothingEnabled = false;
  pen.drawImage(bitmap(canvas, pixels), box.left, box.top, box.width, box.height);
  colourBar(pen, { left: box.left + box.width + 6, top: box.top, width: 11, height: box.height }, [-reach, reach], colours, "contrast (°)");
  pen.fillStyle = INK;
  data.zeros[0].forEach((x, i) => pen.fillRect(axes.x(x) - 1, axes.y(data.zeros[1][i]) - 1, 2.5, 2.5));
  if (data.best[0] !== null) axes.diamond(...data.best);
  if (point) axes.ring(Math.max(xlim[0], Math.min(xlim[1], point[0])), Math.max(ylim[0], Math.min(ylim[1], point[1])), INK, 5.5);
  return axes;
}
