// The kernels that kernels.py compiled, called with numbers and arrays as numba passes them.

const LIBM = ["acos", "acosh", "asin", "asinh", "atan", "atan2", "cos", "cosh", "exp", "expm1", "hypot", "log", "log1p", "pow", "sin", "sinh", "tan", "tanh"];
const BYTES = { float64: 8, int64: 8, int8: 1, bool: 1 };
const PAGE = 65536, ALIGNED = 64, SPARE = 256; // bytes, bytes, pages
const DATA = 16; // place of the address of the data in numba's NRT_MemInfo: a count of 8 bytes, and two addresses before it

const product = (numbers) => numbers.reduce((a, b) => a * b, 1);
const up = (at, to) => Math.ceil(at / to) * to;

export class Kernels {
  /** `code`: of kernels.wasm; `table`: what kernels.json says. */
  static async load(code, { entries, formulas }) {
    const self = new Kernels(), module = await WebAssembly.compile(code);
    const missing = (name) => () => { throw new Error(`the kernels call ${name}, which is not there`); };
    const env = Object.fromEntries(WebAssembly.Module.imports(module).map(({ name }) => [name, missing(name)]));
    for (const name of LIBM) env[name] = Math[name];
    env.fmod = (a, b) => a % b;
    env.NRT_MemInfo_alloc_aligned = (size, align) => self.allocate(Number(size), align);
    env.NRT_MemInfo_call_dtor = () => {}; // the heap is given back as a whole
    env.__multi3 = (to, a, above, b, over) => self.multiply(to, a, above, b, over);
    self.exports = (await WebAssembly.instantiate(module, { env })).exports;
    self.heap = up(self.exports.__heap_base.value, ALIGNED);
    self.entries = entries;
    self.formulas = Object.fromEntries(Object.entries(formulas).map(([name, symbol]) => [name, self.place(self.exports[symbol])]));
    return self;
  }

  get memory() { return new DataView(this.exports.memory.buffer); }

  /** Memory of so many bytes. */
  take(bytes) {
    const at = this.heap, end = (this.heap = up(at + bytes, ALIGNED)), { memory } = this.exports;
    if (end > memory.buffer.byteLength) memory.grow(Math.ceil((end - memory.buffer.byteLength) / PAGE) + SPARE);
    return at;
  }

  /** Copies bytes to where they stay, for they are taken between calls; returns the address. */
  keep(bytes) {
    const at = this.take(bytes.byteLength);
    new Uint8Array(this.exports.memory.buffer, at, bytes.byteLength).set(bytes);
    return at;
  }

  /** What numba asks for an array: a header that counts references, and the data. */
  allocate(size, align) {
    const header = this.take(64), data = up(this.take(size + align), align);
    this.memory.setBigInt64(header, 1n, true);
    this.memory.setUint32(header + DATA, data, true);
    return header;
  }

  multiply(to, a, above, b, over) {
    const whole = (low, high) => BigInt.asUintN(64, low) | (BigInt.asUintN(64, high) << 64n), found = whole(a, above) * whole(b, over);
    this.memory.setBigUint64(to, BigInt.asUintN(64, found), true);
    this.memory.setBigUint64(to + 8, BigInt.asUintN(64, found >> 64n), true);
  }

  /** The place of a function in the table through which it is called. */
  place(formula) {
    const table = this.exports.__indirect_function_table, at = table.grow(1);
    table.set(at, formula);
    return at;
  }

  /**
   * Calls an entry by its name in Python. `parts`: [type, number] for each number, and [type, shape, i] for an array or a
   * record that lies in `buffers[i]`, a Uint8Array which is changed as the entry changes it. Returns what `answer` is of;
   * of an array { given, shape, bytes }, where `given` is the number of the buffer that it is, or -1.
   */
  call(name, parts, buffers) {
    const before = this.heap, { symbol, answer } = this.entries[name];
    try {
      const to = this.take(4096), error = this.take(16), places = buffers.map((one) => this.take(Math.max(one.byteLength, 1))); // each another
      buffers.forEach((one, i) => new Uint8Array(this.exports.memory.buffer, places[i], one.byteLength).set(one));
      const code = this.exports[symbol](to, error, ...parts.flatMap((part) => this.passed(part, places)));
      if (code !== 0) throw new Error(`${name} fails with code ${code}`);
      buffers.forEach((one, i) => one.set(new Uint8Array(this.exports.memory.buffer, places[i], one.byteLength)));
      return this.read(answer, { at: to }, places);
    } finally {
      this.heap = before;
    }
  }

  /** What is passed for a part: of an array two addresses that are unused here, sizes, the data, shape and strides. */
  passed([type, value, i], places) {
    if (i === undefined) return [type === "int64" ? BigInt(value) : Number(value)];
    if (type === "record") return [places[i]];
    const size = BYTES[type], strides = value.map((_, axis) => BigInt(size * product(value.slice(axis + 1))));
    return [0, 0, BigInt(product(value)), BigInt(size), places[i], ...value.map(BigInt), ...strides];
  }

  /** What was returned at a place: numba's structures as C lays them out. */
  read(kind, place, places) {
    const next = (size) => { place.at = up(place.at, size) + size; return place.at - size; };
    const whole = () => Number(this.memory.getBigInt64(next(8), true));
    if (kind === "none") return null;
    if (kind === "float64") return this.memory.getFloat64(next(8), true);
    if (kind === "int64") return whole();
    if (kind === "bool") return this.memory.getUint8(next(1)) !== 0;
    place.at = up(place.at, 8); // so structures begin, and end
    const parts = kind.fields ?? kind.items;
    const found = parts ? parts.map((one) => this.read(one, place, places)) : this.array(kind, next, whole, places);
    place.at = up(place.at, 8);
    return found;
  }

  array({ array, dimensions }, next, whole, places) {
    next(4); next(4); whole(); whole();
    const at = this.memory.getUint32(next(4), true), shape = Array.from({ length: dimensions }, whole);
    shape.forEach(whole);
    return { given: places.indexOf(at), shape, bytes: new Uint8Array(this.exports.memory.buffer, at, BYTES[array] * product(shape)).slice() };
  }
}
