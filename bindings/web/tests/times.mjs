// Times in headless Chromium, as JSON: `scripts/test-web --measure` runs it.
//
// The picture and the frames are those of assets/, 640x480 px; frames are ImageData, since how long a browser needs for
// the pixels of a bitmap or a video depends on its graphics. A time is that from the call to the result, with the way to
// the worker and back.

import { readdirSync } from "node:fs";
import { basename, join } from "node:path";
import { launch, serve } from "./browser.mjs";
import { ASSETS, png } from "./common.mjs";

const names = readdirSync(join(ASSETS, "sequence")).filter((name) => name.endsWith(".jpg")).sort();
const frames = names.map((name) => basename(png(`sequence/${name}`)));
const picture = basename(png("pictures/astronaut.jpg"));
const site = await serve();
const browser = await launch();
const page = await browser.newPage();
await page.goto(site.url);
const told = await page.evaluate(async ([picture, frames]) => {
  const { Keygraph } = await import("./keygraph/keygraph.js");
  const file = async (name) => (await fetch(`shots/${name}`)).blob();
  const median = (times) => times.sort((a, b) => a - b)[times.length >> 1];
  const timed = async (work) => {
    const start = performance.now();
    const result = await work();
    return [performance.now() - start, result];
  };
  const cover = await file(picture);
  const trained = [];
  for (let i = 0; i < 3; i++) trained.push(await timed(() => Keygraph.train(cover, { name: "astronaut" })));
  const model = trained[0][1];
  const compact = await Keygraph.train(cover, { name: "astronaut", preset: "compact" });
  const pixels = async (name) => {
    const bitmap = await createImageBitmap(await file(name));
    const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d");
    context.drawImage(bitmap, 0, 0);
    return context.getImageData(0, 0, bitmap.width, bitmap.height);
  };
  const shots = [];
  for (const name of frames) shots.push(await pixels(name));
  const [detector, tracker] = [await Keygraph.detector(model), await Keygraph.tracker(model)];
  for (const shot of shots) await detector.detect(shot); // Until all of it is compiled well.
  const [searched, followed] = [[], []];
  for (const shot of shots) searched.push(await timed(() => detector.detect(shot)));
  for (const shot of shots) followed.push(await timed(() => tracker.track(shot)));
  const found = searched.filter(([, line], i) => i % 4 === 0 && line.detections.length > 0).length;
  const only = followed.filter(([, line]) => !line.searched).map(([ms]) => ms);
  return {
    train_s: median(trained.map(([ms]) => ms)) / 1e3, model_mb: model.data.length / 1e6, compact_mb: compact.data.length / 1e6,
    search_ms: median(searched.map(([ms]) => ms)), follow_ms: median(only), frames: frames.length, found,
  };
}, [picture, frames]);
await browser.close();
site.server.close();
console.log(JSON.stringify(told));
