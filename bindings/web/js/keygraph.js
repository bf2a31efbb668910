// Finds planar objects from one picture, in a page.
//
// Everything is computed here, in workers: no pixel leaves the page. `keygraph.d.ts` describes each function.

import { Engine, KeygraphError, bytesOf } from "./engine.js";
import { pixelsOf } from "./pixels.js";

export { KeygraphError };

// ---------------------------------------------------------------- the module

// A function that uses a vector: browsers without SIMD refuse it.
const VECTORS = Uint8Array.of(
  0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 8, 1, 6, 0, 65, 0, 253, 15, 11,
);

const settings = { module: null, worker: true };
let compiled = null;

async function compile() {
  const name = WebAssembly.validate(VECTORS) ? "keygraph-simd.wasm" : "keygraph.wasm";
  const url = new URL(`./${name}`, import.meta.url);
  const response = await fetch(url).catch((error) => {
    throw new KeygraphError(`${url}: cannot be fetched (${error.message})`, "state");
  });
  if (!response.ok) throw new KeygraphError(`${url}: ${response.status} ${response.statusText}`, "state");
  return WebAssembly.compile(await response.arrayBuffer());
}

function module() {
  if (settings.module) return Promise.resolve(settings.module);
  compiled ??= compile().catch((error) => {
    compiled = null; // The network may be back the next time.
    throw error;
  });
  return compiled;
}

// ---------------------------------------------------------------- one instance

/** An instance of the module in a worker of its own. */
class Remote {
  #worker = new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
  #waiting = new Map();
  #next = 0;
  #closed = null;
  memory = 0;

  constructor(progress) {
    this.#worker.onmessage = ({ data }) => {
      if (data.progress) return progress?.(...data.progress);
      const { resolve, reject } = this.#waiting.get(data.id);
      this.#waiting.delete(data.id);
      this.memory = data.memory ?? this.memory;
      if (data.error) reject(new KeygraphError(data.error.message, data.error.kind));
      else resolve({ head: data.head, bytes: data.bytes });
    };
    this.#worker.onerror = (event) => {
      event.preventDefault?.();
      this.close(new KeygraphError(`the worker cannot run: ${event.message ?? "is worker.js there?"}`, "defect"));
    };
  }

  #send(message, transfer = []) {
    if (this.#closed) return Promise.reject(this.#closed);
    const id = this.#next++;
    return new Promise((resolve, reject) => {
      this.#waiting.set(id, { resolve, reject });
      this.#worker.postMessage({ id, ...message }, transfer);
    });
  }

  start(module) {
    return this.#send({ module });
  }

  ask(head, parts = [], transfer = []) {
    return this.#send({ head, parts }, transfer);
  }

  close(why = new KeygraphError("it was closed", "closed")) {
    if (this.#closed) return;
    this.#closed = why;
    this.#worker.terminate();
    for (const { reject } of this.#waiting.values()) reject(why);
    this.#waiting.clear();
  }
}

/** An instance of the module in this thread, for programs without workers. */
class Local {
  #engine = null;
  #progress;
  #closed = null;

  constructor(progress) {
    this.#progress = progress;
  }

  get memory() {
    return this.#engine?.memory ?? 0;
  }

  async start(module) {
    this.#engine = await Engine.start(module, this.#progress);
  }

  async ask(head, parts) {
    if (this.#closed) throw this.#closed;
    return this.#engine.ask(head, parts);
  }

  close(why = new KeygraphError("it was closed", "closed")) {
    this.#closed ??= why;
    this.#engine = null;
  }
}

async function instance(progress) {
  const compiled = await module();
  const own = settings.worker ? new Remote(progress) : new Local(progress);
  try {
    await own.start(compiled);
  } catch (error) {
    own.close();
    throw error;
  }
  return own;
}

/** Asks an instance that lives for this one call, so that it can be stopped at any time. */
async function once(head, parts, { signal, onProgress } = {}) {
  signal?.throwIfAborted();
  const own = await instance(onProgress);
  const stop = () => own.close(signal.reason);
  try {
    signal?.throwIfAborted();
    signal?.addEventListener("abort", stop);
    return await own.ask(head, parts.map(alone));
  } finally {
    signal?.removeEventListener("abort", stop);
    own.close();
  }
}

/** The bytes without what else is in their buffer, which a worker would get, too. */
const alone = (bytes) => (bytes.byteLength === bytes.buffer.byteLength ? bytes : bytes.slice());

const shape = ({ format, width, height }) => ({ format, width, height });

// ---------------------------------------------------------------- models

const SECRET = Symbol("made by Keygraph");

/** One or many objects to find. */
export class Model {
  constructor(secret, head, bytes, picture = null) {
    if (secret !== SECRET) throw new KeygraphError("use Keygraph.train or Keygraph.read", "value");
    const { warnings = [], ...facts } = head;
    delete facts.picture;
    Object.assign(this, facts);
    this.warnings = Object.freeze(warnings);
    this.objects = Object.freeze(facts.objects.map(Object.freeze));
    this.data = bytes;
    this.picture = picture;
    Object.freeze(this);
  }

  /** The model as a file, to download or to put onto a board. */
  blob() {
    return new Blob([this.data], { type: "application/octet-stream" });
  }
}

/** RGB as RGBA. */
function opaque(rgb, [width, height]) {
  const data = new Uint8ClampedArray(width * height * 4).fill(255);
  for (let i = 0, j = 0; j < rgb.length; i += 4, j += 3) data.set(rgb.subarray(j, j + 3), i);
  return typeof ImageData === "function" ? new ImageData(data, width, height) : { format: "rgba", width, height, data };
}

const modelOf = (value) => {
  if (value instanceof Model) return value;
  throw new KeygraphError("expected a Model, of Keygraph.train or Keygraph.read", "value");
};

async function joined(models) {
  const all = (Array.isArray(models) ? models : [models]).map(modelOf);
  if (all.length === 0) throw new KeygraphError("expected at least one model, got none", "value");
  return all.length === 1 ? all[0] : Keygraph.pack(all);
}

// ---------------------------------------------------------------- detectors

/** A promise, and what fulfils it. */
function promised() {
  let resolve;
  const promise = new Promise((go) => (resolve = go));
  return { promise, resolve };
}

/** Finds objects in frames, each frame by itself. */
export class Detector {
  #own;
  #model;
  #before = Promise.resolve(); // Until the frame before was handed over.

  constructor(secret, own, model) {
    if (secret !== SECRET) throw new KeygraphError("use Keygraph.detector", "value");
    this.#own = own;
    this.#model = model;
  }

  get model() {
    return this.#model;
  }

  get memory() {
    return this.#own.memory;
  }

  async detect(image, { details = false, source = "", frame = 0 } = {}) {
    // A frame that takes long to decode must not be overtaken by the next one.
    const before = this.#before;
    const { promise, resolve } = promised();
    this.#before = promise;
    let answer;
    try {
      const pixels = await pixelsOf(image);
      await before;
      // What somebody else has is copied; what was read here is handed over.
      const data = pixels.own ? pixels.data : pixels.data.slice();
      const head = { call: "look", pixels: shape(pixels), details, source, frame };
      answer = this.#own.ask(head, [data], [data.buffer]);
    } finally {
      before.then(resolve);
    }
    const { head: line, bytes } = await answer;
    if (!details) return line;
    const [corners, keygraphs, votes] = line.details;
    const floats = new Float32Array(bytes.buffer, bytes.byteOffset, bytes.byteLength / 4);
    const [a, b] = [2 * corners, 2 * corners + 6 * keygraphs];
    line.details = {
      corners: floats.subarray(0, a),
      keygraphs: floats.subarray(a, b),
      votes: floats.subarray(b, b + 6 * votes),
    };
    return line;
  }

  /** @protected */
  async restart() {
    await this.#before;
    await this.#own.ask({ call: "restart" });
  }

  close() {
    this.#own.close();
  }
}

/** Follows objects from frame to frame. */
export class Tracker extends Detector {
  track(image, options) {
    return super.detect(image, options);
  }

  reset() {
    return this.restart();
  }
}

async function open(Class, models, options) {
  const model = await joined(models);
  const own = await instance();
  try {
    await own.ask({ call: "open", ...options, track: Class === Tracker }, [model.data]);
  } catch (error) {
    own.close();
    throw error;
  }
  return new Class(SECRET, own, model);
}

// ---------------------------------------------------------------- functions

export const Keygraph = Object.freeze({
  configure({ module = settings.module, worker = settings.worker } = {}) {
    Object.assign(settings, { module, worker });
  },

  async ready() {
    await module();
  },

  async train(image, { signal, ...options } = {}) {
    const pixels = await pixelsOf(image);
    const { head, bytes } = await once({ call: "train", ...options, pixels: shape(pixels) }, [pixels.data], { signal });
    return new Model(SECRET, head, bytes.slice(0, head.bytes), opaque(bytes.subarray(head.bytes), head.picture));
  },

  async read(file) {
    const bytes = typeof Blob === "function" && file instanceof Blob ? await file.arrayBuffer() : file;
    if (!ArrayBuffer.isView(bytes) && !(bytes instanceof ArrayBuffer)) {
      throw new KeygraphError("expected the bytes of a .kgm file, or the file", "value");
    }
    const data = bytesOf(bytes).slice();
    const { head } = await once({ call: "read" }, [data]);
    return new Model(SECRET, head, data);
  },

  async pack(models) {
    const all = models.map(modelOf);
    const lengths = all.map((model) => model.data.byteLength);
    const { head, bytes } = await once({ call: "pack", lengths }, all.map((model) => model.data));
    return new Model(SECRET, head, bytes);
  },

  async assess(model, { picture = modelOf(model).picture, signal, onProgress, ...options } = {}) {
    if (!picture) throw new KeygraphError("give the picture that the model was made from: { picture }", "value");
    const pixels = await pixelsOf(picture);
    const head = { call: "assess", ...options, pixels: shape(pixels), model: model.data.byteLength };
    const answer = await once(head, [model.data, pixels.data], { signal, onProgress });
    return { ...answer.head, heat: opaque(answer.bytes, [pixels.width, pixels.height]) };
  },

  detector: (models, options = {}) => open(Detector, models, options),
  tracker: (models, options = {}) => open(Tracker, models, options),
});

export default Keygraph;
