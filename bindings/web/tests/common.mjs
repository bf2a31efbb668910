// What the tests have in common: where things are, this machine's program, pictures as pixels.

import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { join } from "node:path";

/** An environment variable that scripts/test-web sets. */
function given(name) {
  const value = process.env[name];
  if (!value) throw new Error(`${name} is not set: run scripts/test-web`);
  return value;
}

export const ROOT = given("KEYGRAPH_ROOT");
export const PACKAGE = given("KEYGRAPH_WEB"); // What scripts/package-web made: npm, site.
export const WORK = given("KEYGRAPH_WORK"); // A folder that is removed after the tests.
export const ASSETS = join(ROOT, "assets");

/** Runs this machine's keygraph; gives what it prints. */
export function keygraph(...args) {
  return execFileSync(given("KEYGRAPH"), args, { encoding: "utf8", maxBuffer: 1 << 28, stdio: ["ignore", "pipe", "ignore"] });
}

/** The lines that a command prints, parsed. */
export const lines = (...args) => keygraph(...args).trim().split("\n").map((line) => JSON.parse(line));

/** A picture of assets/ as a PNG file, which every decoder reads alike. */
export function png(name) {
  const file = join(WORK, `${name.replaceAll("/", "-")}.png`);
  execFileSync("ffmpeg", ["-v", "error", "-y", "-i", join(ASSETS, name), file]);
  return file;
}

/** The pixels of a picture, RGBA. */
export function rgba(file) {
  const size = execFileSync("ffprobe", ["-v", "error", "-show_entries", "stream=width,height", "-of", "csv=p=0", file]);
  const [width, height] = String(size).trim().split(",").map(Number);
  const raw = ["-v", "error", "-i", file, "-f", "rawvideo", "-pix_fmt", "rgba", "-"];
  return { format: "rgba", width, height, data: new Uint8Array(execFileSync("ffmpeg", raw, { maxBuffer: 1 << 28 })) };
}

/** A line without what differs from run to run: times, and the name of the source. */
export function lasting({ source: _source, time_ms: _times, details: _details, ...line }) {
  return line;
}

export const module = (name) => WebAssembly.compile(readFileSync(join(PACKAGE, "npm", `${name}.wasm`)));
