// The package and the page in headless Chromium, with a camera that shows a file.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync, readdirSync, writeFileSync } from "node:fs";
import { basename, join } from "node:path";
import { after, before, describe, test } from "node:test";
import { launch, serve } from "./browser.mjs";
import { PACKAGE, WORK, keygraph, lasting, lines, png } from "./common.mjs";

const SHOT = png("sequence/0005.jpg"); // What the camera shows.
const PICTURE = png("pictures/astronaut.jpg");
// Frames in CI; `KEYGRAPH_WEB_FRAMES=10000` for a long look.
const FRAMES = Number(process.env.KEYGRAPH_WEB_FRAMES ?? 120);
const BLUE = [0x4c, 0xc2, 0xff]; // Of the first object's outline.

let site;
let browser;

/** A page that fails the test when a script of it fails. */
async function open({ camera = true, ...options } = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 }, ...options });
  const page = await context.newPage();
  page.failures = [];
  page.on("pageerror", (error) => page.failures.push(error.message));
  if (!camera) await page.addInitScript(() => (navigator.mediaDevices.getUserMedia = async () => { throw new DOMException("none", "NotFoundError"); }));
  await page.goto(site.url);
  await page.waitForFunction(() => document.getElementById("engine").textContent === "Ready.");
  return page;
}

const text = (page, id) => page.textContent(`#${id}`);
const shows = (page, id, expected) =>
  page.waitForFunction(([i, e]) => new RegExp(e).test(document.getElementById(i).textContent), [id, expected.source], { timeout: 30_000 });

async function learn(page) {
  await page.click("#example");
  await page.click("#train");
  await shows(page, "said", /^Learned astronaut/);
}

describe("the page", () => {
  before(async () => {
    const film = join(WORK, "camera.y4m");
    execFileSync("ffmpeg", ["-v", "error", "-y", "-loop", "1", "-framerate", "15", "-i", SHOT, "-t", "1", "-pix_fmt", "yuv420p", film]);
    site = await serve();
    browser = await launch(`--use-file-for-fake-video-capture=${film}`);
  });

  after(async () => {
    await browser?.close();
    site?.server.close();
  });

  test("learns a picture, and draws its outline where this machine finds it", async () => {
    const page = await open();
    await learn(page);
    await page.click("#start");
    await shows(page, "found", /^astronaut$/);
    const model = join(WORK, "page.kgm");
    keygraph("train", PICTURE, "--name", "astronaut", "-o", model);
    const [{ detections }] = lines("detect", "-m", model, "--json", SHOT);
    const { corners } = detections.find((d) => d.object === "astronaut");
    // Points along the sides, away from the corners and from the name, and the colours around them.
    const points = corners.flatMap(([x, y], i) => {
      const [u, v] = corners[(i + 1) % 4];
      return [0.25, 0.5, 0.75].map((t) => [x + t * (u - x), y + t * (v - y)]);
    });
    const near = await page.evaluate(([points, blue]) => {
      const context = document.getElementById("view").getContext("2d");
      return points.map(([x, y]) => {
        const { data } = context.getImageData(Math.round(x) - 4, Math.round(y) - 4, 9, 9);
        let least = 255;
        for (let i = 0; i < data.length; i += 4) least = Math.min(least, Math.max(...blue.map((c, k) => Math.abs(c - data[i + k]))));
        return least;
      });
    }, [points, BLUE]);
    // The name may lie over a part of the topmost side.
    assert.ok(near.filter((far) => far < 16).length >= points.length - 1, `${near}`);
    await page.check("#votes");
    await page.check("#triangles");
    await shows(page, "found", /^astronaut/);
    await shows(page, "score", /^\d+ of 100$/);
    const shots = process.env.KEYGRAPH_SCREENSHOTS;
    if (shots) await page.screenshot({ path: join(shots, "web.png"), fullPage: true });
    await page.click("#stop");
    assert.equal(await page.isVisible("#stop"), false);
    assert.ok(await page.isVisible("#heat"));
    assert.equal(await page.locator("#table tr").count(), 6);
    assert.deepEqual(page.failures, []);
    await page.context().close();
  });

  test("Chromium computes what this machine computes: models, lines, digests", async () => {
    const page = await open();
    const own = join(WORK, "chromium.kgm");
    keygraph("train", PICTURE, "--name", "astronaut", "-o", own);
    const frames = ["sequence/0005.jpg", "sequence/0020.jpg", "pictures/rocket.jpg"].map(png);
    const got = await page.evaluate(async ([picture, frames, many]) => {
      const { Keygraph } = await import("./keygraph/keygraph.js");
      const file = async (name) => (await fetch(`shots/${name}`)).blob();
      const model = await Keygraph.train(await file(picture), { name: "astronaut" });
      const detector = await Keygraph.detector(model, { digests: true });
      const read = [];
      for (const name of frames) {
        const image = new Image();
        image.src = `shots/${name}`;
        // A file, an image and a bitmap are the same picture.
        const ways = [await file(name), image, await createImageBitmap(await file(name))];
        read.push(await Promise.all(ways.map((way) => detector.detect(way))));
      }
      const bitmaps = await Promise.all(frames.map(async (name) => createImageBitmap(await file(name))));
      const watch = async (n) => {
        for (let i = 0; i < n; i++) await detector.detect(bitmaps[i % 3]);
        return detector.memory;
      };
      const memory = await watch(60);
      return { model: [...model.data], read, grown: (await watch(many)) - memory };
    }, [basename(PICTURE), frames.map((f) => basename(f)), FRAMES]);
    assert.deepEqual(Buffer.from(got.model), readFileSync(own));
    const expected = lines("detect", "-m", own, "--json", "--digests", "--threads", "1", ...frames);
    for (const [i, ways] of got.read.entries()) {
      for (const line of ways) assert.deepEqual({ ...lasting(line), frame: 0 }, { ...lasting(expected[i]), frame: 0 });
    }
    assert.equal(got.grown, 0);
    await page.context().close();
  });

  test("works without a network after the first visit, and sends nothing anywhere", async () => {
    const page = await open();
    await shows(page, "offline", /without a network/);
    const other = await serve();
    // Without a policy, the browser would send this, and hide the answer from the page.
    const send = (url) => fetch(`${url}spy`, { mode: "no-cors" }).then(() => "sent", (error) => error.name);
    assert.equal(await page.evaluate(send, other.url), "TypeError", "the policy of the page refuses other addresses");
    assert.deepEqual(other.strange, [], "nothing has arrived");
    other.server.close();
    await page.context().setOffline(true);
    await page.reload();
    await shows(page, "engine", /Ready/);
    await learn(page);
    await page.click("#play");
    await shows(page, "found", /^astronaut/);
    assert.deepEqual(page.failures, []);
    assert.deepEqual(site.strange, [], "everything that the page asks for is there");
    await page.context().close();
  });

  test("a downloaded model is what the command line reads, and is loaded again", async () => {
    const page = await open();
    await learn(page);
    const [download] = await Promise.all([page.waitForEvent("download"), page.click("#objects >> text=Download .kgm")]);
    assert.equal(download.suggestedFilename(), "astronaut.kgm");
    const file = join(WORK, "downloaded.kgm");
    await download.saveAs(file);
    assert.ok(keygraph("detect", "-m", file, "--json", SHOT).includes('"object":"astronaut"'));
    await page.click("#objects >> text=Remove");
    assert.equal(await page.locator("#objects li").count(), 0);
    await page.setInputFiles("#model", file);
    await shows(page, "said", /^Loaded astronaut/);
    await page.context().close();
  });

  test("is used by keyboard: the outline is moved, and the part within it is learned", async () => {
    const page = await open();
    await page.setInputFiles("#file", SHOT);
    await page.waitForSelector("#work:not([hidden])");
    const model = join(WORK, "keys.kgm");
    keygraph("train", PICTURE, "--name", "astronaut", "-o", model);
    const [{ detections }] = lines("detect", "-m", model, "--json", SHOT);
    // From each corner of the frame to that of the object, in steps of 2.56 px, and of ten times that with Shift.
    for (const [i, [x, y]] of detections[0].corners.entries()) {
      await page.focus(`#corners button:nth-child(${i + 1})`);
      const from = [[0, 0], [639, 0], [639, 479], [0, 479]][i];
      for (const [axis, keys] of [[0, ["ArrowLeft", "ArrowRight"]], [1, ["ArrowUp", "ArrowDown"]]]) {
        const steps = Math.round(([x, y][axis] - from[axis]) / 2.56);
        const key = keys[Number(steps > 0)];
        for (let n = Math.abs(steps); n > 0; n -= n >= 10 ? 10 : 1) await page.keyboard.press(n >= 10 ? `Shift+${key}` : key);
      }
    }
    await page.fill("#name", "by keys");
    await page.keyboard.press("Enter");
    await shows(page, "said", /^Learned by keys/);
    await page.focus("#start");
    await page.keyboard.press("Enter");
    await shows(page, "found", /^by keys/);
    await page.context().close();
  });

  test("fits a phone of 390 px", async () => {
    const page = await open({ viewport: { width: 390, height: 844 }, isMobile: true, hasTouch: true });
    assert.ok(await page.isVisible("#photograph"));
    await learn(page);
    await page.click("#play");
    await shows(page, "found", /^astronaut/);
    await shows(page, "score", /of 100/);
    assert.ok((await page.evaluate(() => document.documentElement.scrollWidth)) <= 390);
    await page.context().close();
  });

  test("says what is wrong and what to do", async () => {
    const page = await open({ camera: false });
    const bad = (name, bytes) => (writeFileSync(join(WORK, name), bytes), join(WORK, name));
    await page.setInputFiles("#file", bad("words.jpg", "words"));
    await shows(page, "said", /words\.jpg is no picture that this browser reads/);
    await page.setInputFiles("#model", bad("words.kgm", "words"));
    await shows(page, "said", /not a keygraph model/);
    await page.setInputFiles("#video", bad("words.mp4", "words"));
    await shows(page, "notice", /words\.mp4 is no video that this browser plays/);
    await page.click("#start");
    await shows(page, "notice", /There is no camera: open a video/);
    const plain = join(WORK, "plain.png");
    execFileSync("ffmpeg", ["-v", "error", "-y", "-f", "lavfi", "-i", "color=gray:s=320x240", "-frames:v", "1", plain]);
    await page.setInputFiles("#file", plain);
    await page.click("#train");
    await shows(page, "said", /too little to hold on to/);
    assert.ok(await page.isVisible("#work"), "another outline or picture can be tried");
    await page.click("#cancel");
    await learn(page);
    await page.click("#example");
    await page.click("#train");
    await shows(page, "said", /There is an object of the name astronaut already/);
    assert.deepEqual(page.failures, []);
    await page.context().close();
  });

  test("the page keeps every file of it", () => {
    const kept = readFileSync(join(PACKAGE, "site/offline.js"), "utf8");
    const files = readdirSync(join(PACKAGE, "site"), { recursive: true, withFileTypes: true }).filter((f) => f.isFile());
    for (const { name } of files) assert.ok(name === "offline.js" || kept.includes(`/${name}"`), name);
    assert.doesNotMatch(kept, /development/);
  });
});
