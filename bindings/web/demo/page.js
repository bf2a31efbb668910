// The page: one side learns pictures, the other looks for them.
//
// In: what the user does. Out: what is seen. The work is done by keygraph.js, in workers.

import { Keygraph } from "./keygraph/keygraph.js";
import { colourOf, draw } from "./drawing.js";
import { Outline } from "./outline.js";
import { camera, cameras, example, video } from "./sources.js";

const $ = (id) => document.getElementById(id);
const EXAMPLE_FRAMES = 24;
// Larger pictures are made smaller before they are learned: models see 640 px of them.
const MOST_PX = 1280;
const CONDITIONS = { scale: "size in the frame", rotation: "turned", tilt: "tilted", blur: "blurred", darkness: "dark", noise: "noisy" };

function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

function say(text, bad = false) {
  Object.assign($("said"), { textContent: text, className: bad ? "bad" : "dim" });
}

/** An action whose failure is told beside it. */
const attempt = (action, tell) => async (event) => {
  event?.preventDefault?.();
  try {
    await action(event);
  } catch (error) {
    if (error.name !== "AbortError") tell(error.message);
  }
};
const learning = (action) => attempt(action, (text) => say(text, true));
const watching = (action) => attempt(action, (text) => ($("notice").textContent = text));

/** What the file input holds, once; the same file can be chosen again. */
function taken(input) {
  const [file] = input.files;
  input.value = "";
  return file;
}

// ---------------------------------------------------------------- the picture

let bitmap = null; // The picture that is being looked at.
let training = null; // What stops the training of it.
const outline = new Outline($("picture"), $("corners"), showPicture);

function showPicture() {
  $("picture").getContext("2d").drawImage(bitmap, 0, 0);
  outline.draw();
}

async function take(file, name) {
  let whole;
  try {
    whole = await createImageBitmap(file);
  } catch {
    throw new Error(`${file.name ?? "The file"} is no picture that this browser reads. Try a JPEG or a PNG.`);
  }
  training?.abort();
  const scale = Math.min(MOST_PX / Math.max(whole.width, whole.height), 1);
  const [resizeWidth, resizeHeight] = [whole.width, whole.height].map((v) => Math.max(Math.round(v * scale), 1));
  bitmap = scale < 1 ? await createImageBitmap(whole, { resizeWidth, resizeHeight, resizeQuality: "high" }) : whole;
  Object.assign($("picture"), { width: bitmap.width, height: bitmap.height });
  $("name").value = name.slice(0, 32) || "object";
  $("work").hidden = false;
  $("drop").hidden = true;
  say("");
  outline.reset();
  showPicture();
  $("train").focus();
}

function leave() {
  training?.abort();
  $("work").hidden = true;
  $("drop").hidden = false;
  bitmap = null;
}

const stem = (file) => file.name.replace(/\.[^.]*$/, "");

for (const input of [$("file"), $("photo")]) {
  input.onchange = learning(async () => {
    const file = taken(input);
    if (file) await take(file, input === $("photo") ? "object" : stem(file));
  });
}
$("example").onclick = learning(async () => {
  const response = await fetch("example/astronaut.jpg");
  if (!response.ok) throw new Error(`example/astronaut.jpg: ${response.status} ${response.statusText}`);
  await take(await response.blob(), "astronaut");
});
$("cancel").onclick = leave;

const isDrag = (event) => [...event.dataTransfer.types].includes("Files");
addEventListener("dragover", (event) => {
  if (!isDrag(event)) return;
  event.preventDefault();
  $("drop").classList.add("over");
});
addEventListener("dragleave", () => $("drop").classList.remove("over"));
addEventListener("drop", learning(async (event) => {
  $("drop").classList.remove("over");
  const [file] = event.dataTransfer.files;
  if (!file) return;
  if (file.name.endsWith(".kgm")) await load(file);
  else await take(file, stem(file));
}));

$("training").onsubmit = learning(async () => {
  const name = $("name").value.trim();
  if (models.has(name)) throw new Error(`There is an object of the name ${name} already: give another name, or remove that one.`);
  training?.abort();
  const own = (training = new AbortController());
  $("train").disabled = true;
  say("Training…");
  try {
    const start = performance.now();
    const options = { name, preset: $("preset").value, outline: outline.points ?? undefined, signal: own.signal };
    const model = await Keygraph.train(bitmap, options);
    const seconds = ((performance.now() - start) / 1000).toFixed(1);
    training = null;
    leave();
    await add(name, model);
    say([`Learned ${name} in ${seconds} s.`, ...model.warnings.map((w) => `${w}.`)].join(" "));
    assess(model);
  } finally {
    if (own.signal.aborted) say("");
    if (training === own || training === null) $("train").disabled = false;
  }
});

// ---------------------------------------------------------------- the assessment

let assessing = null; // { model, and what stops its assessment }

async function assess(model) {
  assessing?.stop.abort();
  const stop = new AbortController();
  const own = (assessing = { model, stop });
  $("report").hidden = false;
  $("progress").hidden = false;
  for (const id of ["score", "verdict"]) $(id).textContent = "";
  for (const part of [$("limits"), $("table").tBodies[0]]) part.replaceChildren();
  for (const part of [$("heat").parentElement, $("table")]) part.hidden = true;
  try {
    const onProgress = (done, all) => ($("progress").value = done / all);
    const report = await Keygraph.assess(model, { views: 4, signal: stop.signal, onProgress });
    $("score").textContent = `${report.score} of 100`;
    $("score").className = report.score >= 80 ? "good" : report.score >= 50 ? "" : "bad";
    $("verdict").textContent = report.limits.length ? "" : "Nothing limits it.";
    $("limits").replaceChildren(...report.limits.map((limit) => element("li", {}, `${limit.text}.`)));
    const { heat } = report;
    Object.assign($("heat"), { width: heat.width, height: heat.height });
    $("heat").getContext("2d").putImageData(heat, 0, 0);
    $("table").tBodies[0].replaceChildren(...report.table.map((row) => {
      const cell = ({ value, found }) => element("td", {}, element("small", {}, `${value}: `), `${Math.round((100 * found) / report.views)}`);
      return element("tr", {}, element("th", { scope: "row" }, `${CONDITIONS[row.condition]}, ${row.unit}`), ...row.cells.map(cell));
    }));
    for (const part of [$("heat").parentElement, $("table")]) part.hidden = false;
  } catch (error) {
    if (!stop.signal.aborted) $("verdict").textContent = error.message;
  } finally {
    if (assessing === own) $("progress").hidden = true;
  }
}

// ---------------------------------------------------------------- the objects

const models = new Map();

async function add(name, model) {
  models.set(name, model);
  try {
    await reopen();
  } catch (error) {
    // It does not go together with the others, which go on being searched for.
    models.delete(name);
    await reopen();
    throw error;
  } finally {
    showObjects();
  }
}

async function load(file) {
  const name = stem(file);
  if (models.has(name)) throw new Error(`There is an object of the name ${name} already: remove that one first.`);
  const model = await Keygraph.read(file);
  await add(name, model);
  say(`Loaded ${model.objects.map((o) => o.name).join(", ")}.`);
}

$("model").onchange = learning(async () => {
  const file = taken($("model"));
  if (file) await load(file);
});

function save(name, model) {
  const link = element("a", { href: URL.createObjectURL(model.blob()), download: `${name.replace(/[^\p{L}\p{N}._-]+/gu, "_")}.kgm` });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

function showObjects() {
  $("objects").replaceChildren(...[...models].map(([name, model]) => {
    const swatch = element("i", { className: "swatch" });
    swatch.style.background = colourOf(model.objects[0].name);
    const download = element("button", { onclick: () => save(name, model) }, "Download .kgm");
    const remove = element("button", { ariaLabel: `Remove ${name}` }, "Remove");
    remove.onclick = learning(async () => {
      models.delete(name);
      if (assessing?.model === model) {
        assessing.stop.abort();
        $("report").hidden = true;
      }
      showObjects();
      say(`${name} removed.`);
      await reopen();
    });
    const size = element("small", {}, ` ${(model.bytes / 1e6).toFixed(1)} MB`);
    return element("li", {}, swatch, element("span", {}, model.objects.map((o) => o.name).join(", "), size), download, remove);
  }));
}

// ---------------------------------------------------------------- the camera

let finder = null; // The detector or tracker of the models.
let source = null;
let opening = Promise.resolve();

/** Opens a detector or a tracker for the models that there are. */
function reopen() {
  opening = opening.catch(() => {}).then(async () => {
    finder?.close();
    finder = null;
    if (models.size === 0) return;
    const options = { threshold: Number($("threshold").value) };
    const make = $("follow").checked ? Keygraph.tracker : Keygraph.detector;
    finder = await make([...models.values()], options);
  });
  return opening;
}

$("follow").onchange = watching(reopen);
$("threshold").oninput = () => ($("least").textContent = Number($("threshold").value).toFixed(2));
$("threshold").onchange = watching(reopen);

function words(line) {
  if (!models.size) return "Nothing to find yet: give it a picture.";
  if (!line?.detections.length) return "Not in sight.";
  // Without scores, which change in every frame: a screen reader says each change.
  return line.detections.map((d) => d.object).join(", ");
}

let told = 0;
let arrivals = [];

function tell(line, took) {
  const now = performance.now();
  arrivals = arrivals.filter((t) => now - t < 2000).concat(now);
  if (now - told < 250) return; // Words change four times a second at most.
  told = now;
  const said = words(line);
  if ($("found").textContent !== said) $("found").textContent = said;
  const rate = ((arrivals.length - 1) * 1000) / Math.max(now - arrivals[0], 1);
  const search = line ? `, ${line.time_ms.total.toFixed(1)} ms to search, ${took.toFixed(1)} ms with the copy` : "";
  $("speed").textContent = `${Math.max(rate, 0).toFixed(0)} frames a second${search}`;
}

/** Searches frame after frame until the source ends, or another one takes its place. */
async function watch(open) {
  stop();
  $("notice").textContent = "";
  const own = (source = await open());
  $("stop").hidden = false;
  arrivals = [];
  try {
    for (let frame; source === own && (frame = await own.next()); frame.close()) {
      const show = { triangles: $("triangles").checked, votes: $("votes").checked };
      const start = performance.now();
      // A detector that is opened anew ends the search of this frame.
      const line = await finder?.detect(frame, { details: show.triangles || show.votes }).catch((error) => {
        if (error.kind !== "closed") throw error;
      });
      draw($("view"), frame, line, show);
      tell(line, performance.now() - start);
    }
  } finally {
    if (source === own) stop();
    else own.close();
  }
}

function stop() {
  source?.close();
  source = null;
  $("stop").hidden = true;
}

async function watchCamera(id) {
  await watch(async () => {
    const opened = await camera(id);
    const all = await cameras();
    $("camera").hidden = all.length < 2;
    $("camera").replaceChildren(...all.map((c, i) => element("option", { value: c.deviceId, selected: c.deviceId === opened.id }, c.label || `Camera ${i + 1}`)));
    return opened;
  });
}

$("start").onclick = watching(() => watchCamera(null));
$("camera").onchange = watching(() => watchCamera($("camera").value));
$("stop").onclick = stop;
$("play").onclick = watching(() => watch(async () => example(EXAMPLE_FRAMES)));
$("video").onchange = watching(async () => {
  const file = taken($("video"));
  if (file) await watch(() => video(file));
});

// ---------------------------------------------------------------- the start

Keygraph.ready().then(
  () => ($("engine").textContent = "Ready."),
  (error) => say(`Keygraph cannot start here: ${error.message}`, true),
);
if ("serviceWorker" in navigator) {
  navigator.serviceWorker.register("offline.js").then(
    () => navigator.serviceWorker.ready.then(() => ($("offline").textContent = "It works without a network from now on.")),
    () => {}, // Without it, the page needs the network each time.
  );
}
