// The WebAssembly module of Keygraph, and messages to it.
//
// In: a compiled module, heads (objects) and bytes. Out: heads and bytes. It needs nothing of a browser: it
// runs in a worker, in a page and in Node.js. `src/lib.rs` says how messages lie in the module's memory.

/** An error that Keygraph reports. `kind` is "training", "model", "value", "state", "closed" or "defect". */
export class KeygraphError extends Error {
  constructor(message, kind = "value") {
    super(message);
    this.name = "KeygraphError";
    this.kind = kind;
  }
}

// The numbers of WASI's errors: success, and a function that is not there.
const SUCCESS = 0;
const NOT_THERE = 52;

/** What the module may ask of the system: the time, random numbers, and a way to say why it ends. */
function system(memory) {
  const words = () => new DataView(memory().buffer);
  const said = new TextDecoder();
  let last = "";
  const functions = {
    clock_time_get(_clock, _precision, place) {
      words().setBigUint64(place, BigInt(Math.round(performance.now() * 1e6)), true);
      return SUCCESS;
    },
    random_get(place, length) {
      crypto.getRandomValues(new Uint8Array(memory().buffer, place, length));
      return SUCCESS;
    },
    environ_sizes_get(count, size) {
      words().setUint32(count, 0, true);
      words().setUint32(size, 0, true);
      return SUCCESS;
    },
    environ_get: () => SUCCESS,
    fd_write(_file, pieces, count, written) {
      let sum = 0;
      for (let i = 0; i < count; i++) {
        const place = words().getUint32(pieces + 8 * i, true);
        const length = words().getUint32(pieces + 8 * i + 4, true);
        last = (last + said.decode(new Uint8Array(memory().buffer, place, length))).slice(-2000);
        sum += length;
      }
      words().setUint32(written, sum, true);
      return SUCCESS;
    },
    proc_exit() {
      throw new KeygraphError("the module ended", "defect");
    },
  };
  return { functions, last: () => last };
}

/** One instance of the module: its memory holds one detector or tracker. */
export class Engine {
  #exports;
  #system;
  #broken = null;

  /** @hidden Use Engine.start. */
  constructor(exports, system) {
    this.#exports = exports;
    this.#system = system;
  }

  /**
   * Instantiates the module. `progress(done, all)` is called while a picture is assessed.
   * @returns {Promise<Engine>}
   */
  static async start(module, progress = () => {}) {
    let exports;
    const own = system(() => exports.memory);
    const wasi = {};
    for (const { module: from, name } of WebAssembly.Module.imports(module)) {
      if (from === "wasi_snapshot_preview1") wasi[name] = own.functions[name] ?? (() => NOT_THERE);
    }
    const instance = await WebAssembly.instantiate(module, { wasi_snapshot_preview1: wasi, keygraph: { progress } });
    exports = instance.exports;
    exports._initialize();
    return new Engine(exports, own);
  }

  /** The bytes of the module's memory. They grow with the largest message, and not from frame to frame. */
  get memory() {
    return this.#exports.memory.buffer.byteLength;
  }

  /**
   * Sends a head and bytes, and returns the head and the bytes of the answer.
   * Throws a KeygraphError when the answer is an error.
   */
  ask(head, parts = []) {
    if (this.#broken) throw this.#broken;
    const text = new TextEncoder().encode(JSON.stringify(head));
    const length = parts.reduce((sum, part) => sum + part.byteLength, text.byteLength);
    let answer;
    try {
      const place = this.#exports.reserve(length);
      const message = new Uint8Array(this.#exports.memory.buffer, place, length);
      message.set(text);
      let at = text.byteLength;
      for (const part of parts) {
        message.set(bytesOf(part), at);
        at += part.byteLength;
      }
      this.#exports.call(text.byteLength);
      const [start, size] = [this.#exports.answer(), this.#exports.answer_length()];
      answer = new Uint8Array(this.#exports.memory.buffer, start, size);
    } catch (error) {
      // A trap leaves the memory of the module as it was in the middle of a call.
      this.#broken = new KeygraphError(`Keygraph stopped: ${this.#system.last().trim() || error.message}`, "defect");
      throw this.#broken;
    }
    const split = this.#exports.answer_head();
    const told = split ? JSON.parse(new TextDecoder().decode(answer.subarray(0, split))) : {};
    if (told.error !== undefined) throw new KeygraphError(told.error, told.kind);
    return { head: told, bytes: answer.slice(split) };
  }
}

/** The bytes of a buffer or of a view of one. */
export function bytesOf(part) {
  return ArrayBuffer.isView(part) ? new Uint8Array(part.buffer, part.byteOffset, part.byteLength) : new Uint8Array(part);
}
