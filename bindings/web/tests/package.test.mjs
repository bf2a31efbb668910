// The package in Node.js, with and without vectors, beside this machine's program.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { before, describe, test } from "node:test";
import Ajv from "ajv/dist/2020.js";
import { PACKAGE, ROOT, WORK, keygraph, lasting, lines, module, png, rgba } from "./common.mjs";

const { Keygraph, KeygraphError, Model } = await import(join(PACKAGE, "npm/keygraph.js"));

// Frames that show both objects, one of them, part of one, and none.
const SHOWN = ["0000", "0005", "0009", "0016", "0020", "0025", "0031", "0040", "0047"].map((n) => png(`sequence/${n}.jpg`));
const OTHER = png("pictures/rocket.jpg");
const PICTURES = { astronaut: png("pictures/astronaut.jpg"), coffee: png("pictures/coffee.jpg") };
// Frames in CI; `KEYGRAPH_WEB_FRAMES=10000` for a long look.
const FRAMES = Number(process.env.KEYGRAPH_WEB_FRAMES ?? 200);

const fails = (promise, kind, text) =>
  assert.rejects(promise, (error) => {
    assert.ok(error instanceof KeygraphError, `${error}`);
    assert.equal(error.kind, kind);
    assert.match(error.message, text);
    return true;
  });

for (const name of ["keygraph", "keygraph-simd"]) {
  describe(name, () => {
    const models = [];
    let both;

    before(async () => {
      Keygraph.configure({ module: await module(name), worker: false });
      for (const [object, file] of Object.entries(PICTURES)) models.push(await Keygraph.train(rgba(file), { name: object }));
      both = await Keygraph.pack(models);
    });

    test("the module is small: 400 KB compressed", async () => {
      const { gzipSync } = await import("node:zlib");
      assert.ok(gzipSync(readFileSync(join(PACKAGE, `npm/${name}.wasm`)), { level: 9 }).length <= 400_000);
    });

    test("models are those of this machine, to the byte", () => {
      for (const [i, [object, file]] of Object.entries(PICTURES).entries()) {
        const own = join(WORK, `${object}.kgm`);
        keygraph("train", file, "--name", object, "-o", own);
        assert.deepEqual(Buffer.from(models[i].data), readFileSync(own));
        const [facts] = lines("inspect", "--json", own);
        for (const key of ["objects", "bytes", "keypoints", "keygraphs", "feature", "views"]) assert.deepEqual(models[i][key], facts[key]);
      }
      const packed = join(WORK, "both.kgm");
      keygraph("pack", join(WORK, "astronaut.kgm"), join(WORK, "coffee.kgm"), "-o", packed);
      assert.deepEqual(Buffer.from(both.data), readFileSync(packed));
    });

    test("frames give the lines of this machine, with the digests of all stages", async () => {
      const options = { digests: true, allNames: true, threshold: 0.5, intrinsics: [600, 600, 320, 240], widthMm: { astronaut: 210, coffee: 297 }, distortion: [-0.1, 0.02, 0, 0] };
      const detector = await Keygraph.detector(both, options);
      const flags = ["--digests", "--all-names", "--threshold", "0.5", "--intrinsics", "600,600,320,240", "--distortion", "-0.1,0.02,0,0"];
      flags.push("--width-mm", "astronaut=210", "--width-mm", "coffee=297");
      const expected = lines("detect", "-m", join(WORK, "both.kgm"), "--json", "--threads", "1", ...flags, ...SHOWN, OTHER);
      const ajv = new Ajv({ strict: false });
      const valid = ajv.compile(JSON.parse(readFileSync(join(ROOT, "docs/schema/detection.json"), "utf8")));
      let found = 0;
      for (const [i, file] of [...SHOWN, OTHER].entries()) {
        const line = await detector.detect(rgba(file), { source: file });
        assert.deepEqual(lasting(line), lasting(expected[i]), file);
        assert.ok(valid(line), JSON.stringify(valid.errors));
        found += line.detections.length;
      }
      assert.ok(found >= 10, `${found} found`);
      detector.close();
    });

    test("profiles, regions and mirrored frames are those of this machine", async () => {
      for (const [options, flags] of [
        [{ profile: "qvga" }, ["--profile", "qvga"]],
        [{ profile: "hd", thorough: true }, ["--profile", "hd", "--thorough"]],
        [{ roi: "10%,5%,80%,90%", minVisible: 0.3 }, ["--roi", "10%,5%,80%,90%", "--min-visible", "0.3"]],
        [{ mirror: true }, ["--mirror"]],
        [{ wide: true }, ["--wide"]],
      ]) {
        const detector = await Keygraph.detector(models[0], options);
        const [expected] = lines("detect", "-m", join(WORK, "astronaut.kgm"), "--json", ...flags, SHOWN[1]);
        assert.deepEqual(lasting(await detector.detect(rgba(SHOWN[1]))), lasting(expected), flags.join(" "));
        detector.close();
      }
    });

    test("a tracker gives the lines of this machine, and starts anew", async () => {
      const folder = SHOWN.slice(0, 6);
      const expected = (...flags) => lines("detect", "-m", join(WORK, "both.kgm"), "--json", "--track", ...flags, ...folder);
      const follow = async (tracker, all) => {
        for (const [i, file] of folder.entries()) {
          const line = await tracker.track(rgba(file), { frame: all[i].frame });
          assert.deepEqual(lasting(line), lasting(all[i]), file);
        }
      };
      const [tracker, smooth] = [await Keygraph.tracker(both), await Keygraph.tracker(both, { smooth: 5 })];
      const [plain, smoothed] = [expected(), expected("--smooth=5")];
      await follow(tracker, plain);
      await follow(smooth, smoothed);
      assert.notDeepEqual(smoothed.map(lasting), plain.map(lasting));
      const ids = async () => (await tracker.track(rgba(SHOWN[0]))).detections.map((d) => d.id);
      const before = await ids();
      await tracker.reset();
      const after = await ids();
      assert.ok(before.length > 0 && after.length > 0, "objects are followed");
      assert.ok(after.every((id) => !before.includes(id)), `${before} ${after}`);
      tracker.close();
    });

    test("details are the corners and triangles", async () => {
      const detector = await Keygraph.detector(models[0]);
      const { details, detections } = await detector.detect(rgba(SHOWN[0]), { details: true });
      assert.ok(details.corners.length > 200 && details.keygraphs.length > 600);
      assert.equal(details.votes.length % 6, 0);
      assert.ok(detections[0].votes > 0 && details.votes.length >= 6);
      assert.ok(details.corners.every((v) => v >= 0 && v < 640));
      detector.close();
    });

    test("an assessment is that of this machine", async () => {
      const ticks = [];
      const { heat, ...report } = await Keygraph.assess(models[0], { views: 1, onProgress: (done, all) => ticks.push([done, all]) });
      const args = ["assess", PICTURES.astronaut, "--json", "--views", "1", "--annotate", join(WORK, "heat.png")];
      const [expected] = lines(...args);
      // The command names the object after the file.
      assert.deepEqual({ ...report, object: "" }, { ...expected, object: "" });
      assert.deepEqual(ticks, ticks.map((_, i) => [i + 1, ticks.length]));
      const drawn = rgba(join(WORK, "heat.png"));
      assert.deepEqual([heat.width, heat.height], [drawn.width, drawn.height]);
      assert.deepEqual(Buffer.from(heat.data), Buffer.from(drawn.data));
    });

    test("an outline in a larger picture is cut out", async () => {
      const frame = rgba(SHOWN[0]);
      const detector = await Keygraph.detector(models[0]);
      const [found] = (await detector.detect(frame)).detections;
      const model = await Keygraph.train(frame, { name: "cut", outline: found.corners });
      const own = await Keygraph.detector(model);
      const [again] = (await own.detect(frame)).detections;
      const apart = again.corners.map(([x, y], i) => Math.hypot(x - found.corners[i][0], y - found.corners[i][1]));
      assert.ok(Math.max(...apart) < 3, `${apart}`);
      await fails(Keygraph.train(frame, { outline: found.corners.toReversed() }), "value", /clockwise/);
    });

    test("transparent surroundings are left out, as in files", async () => {
      const { width, height, data } = rgba(PICTURES.astronaut);
      const wide = { format: "rgba", width: width + 40, height, data: new Uint8Array((width + 40) * height * 4) };
      for (let y = 0; y < height; y++) wide.data.set(data.subarray(y * width * 4, (y + 1) * width * 4), (y * wide.width + 20) * 4);
      const model = await Keygraph.train(wide, { name: "astronaut" });
      assert.deepEqual([model.picture.width, model.picture.height], [width, height]);
      assert.deepEqual(Buffer.from(model.data), Buffer.from(models[0].data));
      assert.match(model.warnings[0], /transparent around/);
      await fails(Keygraph.train({ ...wide, data: new Uint8Array(wide.data.length) }), "value", /transparent everywhere/);
    });

    test("every mistake says what was expected", async () => {
      const grey = { format: "gray", width: 64, height: 64, data: new Uint8Array(64 * 64) };
      await fails(Keygraph.train(grey), "training", /too little to hold on to/);
      await fails(Keygraph.train({ ...grey, width: 65 }), "value", /65x64 pixels of this format have 4160 bytes, and 4096 were given/);
      await fails(Keygraph.train({ ...grey, format: "i420", width: 63, height: 1 }), "value", /even/);
      await fails(Keygraph.train(grey, { nmae: "x" }), "value", /unknown field `nmae`/);
      await fails(Keygraph.train(grey, { preset: "huge" }), "value", /"large", "standard", "compact", "paper"; got "huge"/);
      await fails(Keygraph.train(grey, { name: "a\nb" }), "value", /control character/);
      await fails(Keygraph.train(null), "value", /got nothing/);
      await fails(Keygraph.train({ width: 1 }), "value", /expected ImageData, a canvas/);
      await fails(Keygraph.read(new Uint8Array(100)), "model", /not a keygraph model/);
      await fails(Keygraph.read("file.kgm"), "value", /bytes of a .kgm file/);
      const damaged = models[0].data.slice();
      damaged[5000] ^= 1;
      await fails(Keygraph.read(damaged), "model", /damaged/);
      await fails(Keygraph.detector([]), "value", /at least one model/);
      await fails(Keygraph.detector([models[0], {}]), "value", /expected a Model/);
      await fails(Keygraph.detector(models[0], { profile: "4k" }), "value", /"hd", "vga", "qvga", "qqvga"; got "4k"/);
      await fails(Keygraph.detector(models[0], { threshold: 2 }), "value", /threshold: expected 0 to 1, got 2/);
      await fails(Keygraph.detector(models[0], { budgetMs: 0 }), "value", /budgetMs/);
      await fails(Keygraph.detector(models[0], { roi: "1,2" }), "value", /roi/);
      await fails(Keygraph.detector(models[0], { widthMm: 10 }), "value", /both intrinsics and widthMm/);
      await fails(Keygraph.detector(models[0], { distortion: [0, 0, 0, 0] }), "value", /distortion needs intrinsics/);
      await fails(Keygraph.detector(models[0], { smooth: 5 }), "value", /smooth: for trackers/);
      await fails(Keygraph.tracker(models[0], { smooth: 256 }), "value", /u8/);
      await fails(Keygraph.tracker(models[0], { wide: true }), "value", /wide: for detectors/);
      await fails(Keygraph.detector(models[0], { wide: true, digests: true }), "value", /leave out/);
      await fails(Keygraph.assess(both, { picture: grey }), "value", /one by one/);
      await fails(Keygraph.assess(await Keygraph.read(models[0].data)), "value", /picture that the model was made from/);
      assert.throws(() => new Model({}), KeygraphError);
      const detector = await Keygraph.detector(models[0]);
      await fails(detector.detect({ ...grey, width: 4, height: 4, data: new Uint8Array(16) }), "value", /too small|at least/);
      detector.close();
      await fails(detector.detect(grey), "closed", /was closed/);
    });

    test("memory stays as it is", async () => {
      const detector = await Keygraph.detector(both);
      const frames = [SHOWN[0], SHOWN[3], OTHER].map(rgba);
      for (const frame of frames) await detector.detect(frame);
      const start = detector.memory;
      for (let i = 0; i < FRAMES; i++) await detector.detect(frames[i % frames.length]);
      assert.equal(detector.memory, start);
      detector.close();
    });
  });
}

