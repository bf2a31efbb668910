// Headless Chromium, and a server of the page.

import { readFileSync } from "node:fs";
import { createServer } from "node:http";
import { extname, join } from "node:path";
import { chromium } from "playwright-core";
import { PACKAGE, WORK } from "./common.mjs";

const TYPES = {
  ".html": "text/html", ".js": "text/javascript", ".wasm": "application/wasm", ".css": "text/css", ".jpg": "image/jpeg",
  ".png": "image/png", ".svg": "image/svg+xml", ".webmanifest": "application/manifest+json",
};
const FLAGS = [
  "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
  "--disable-component-update", "--disable-sync", "--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream",
];

/** Serves the page, and pictures below /shots/; counts what other paths are asked for. */
export async function serve() {
  const strange = [];
  const server = createServer((request, response) => {
    const path = new URL(request.url, "http://localhost").pathname;
    const file = path.startsWith("/shots/") ? join(WORK, path.slice(7)) : join(PACKAGE, "site", path.endsWith("/") ? `${path}index.html` : path);
    try {
      const body = readFileSync(file);
      response.writeHead(200, { "content-type": TYPES[extname(file)] ?? "application/octet-stream" }).end(body);
    } catch {
      strange.push(path);
      response.writeHead(404).end();
    }
  });
  await new Promise((go) => server.listen(0, "localhost", go));
  return { server, strange, url: `http://localhost:${server.address().port}/` };
}

/** Headless Chromium with these options more. */
export function launch(...more) {
  return chromium.launch({ executablePath: process.env.KEYGRAPH_CHROMIUM, args: [...FLAGS, ...more] });
}
