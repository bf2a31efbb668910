'use strict';
// Frames from the program, what is said about them, and the controls.

const $ = id => document.getElementById(id);
const COLOURS = ['#4cc2ff', '#ffb000', '#78e08f', '#ff7eb6', '#b79cff', '#f4f072', '#ff8a65', '#5eead4'];
const view = $('view'), context = view.getContext('2d');

// What is on the canvas: {number, bitmap, width, height, jpeg, seen, line, corners, keygraphs, votes}; null before the
// first frame.
let shown = null;
let frozen = null;           // what is being learned from, see lesson.js
let token = tokenInAddress() || sessionStorage.getItem('token') || '';
let proven = null;           // the token that the program took last
let entered = null;          // called when another token is given
let errand = null, done = ''; // `keygraph train --from-camera`: what it waits for; what became of it
let generation = null, objects = [], dragging = false, arrivals = [], latency = null;

function element(tag, properties = {}, ...children) {
  const e = Object.assign(document.createElement(tag), properties);
  e.append(...children);
  return e;
}

// An action whose failure is told to the user.
function attempt(action) {
  return async event => {
    event?.preventDefault?.();
    try { await action(event); } catch (error) { say(error.message, true); }
  };
}

// ---------------------------------------------------------------- requests

/** The program does not take the token. */
class Refused extends Error {}

async function ask(path, options = {}) {
  const sent = token;
  const headers = sent ? { Authorization: 'Bearer ' + sent } : {};
  const answer = await fetch(path, { ...options, headers }).catch(() => { throw new Error('The program does not answer.'); });
  if (answer.status === 401) throw new Refused(refuse(sent));
  if (sent === token) {
    proven = sent;
    if (sent) sessionStorage.setItem('token', sent);
    $('key').hidden = true;
  }
  if (!answer.ok) throw new Error(sentence(await answer.text()));
  return answer;
}

// Says what is wrong with the token, and asks for another.
function refuse(sent) {
  const remedy = 'open the address that the program printed at its start, or type the token into its field.';
  const why = !sent ? `This page needs a token: ${remedy}`
    : sent === proven ? `The token has changed, since the program was started anew: ${remedy}`
      : `The token is wrong: ${remedy}`;
  $('key').hidden = false;
  $('refusal').textContent = why;
  return why;
}

function tokenInAddress() { return new URLSearchParams(location.hash.slice(1)).get('token'); }

function enter(given) {
  if (!given) return;
  token = given;
  $('refusal').textContent = 'Trying the token…';
  entered?.();
}

$('keyform').onsubmit = event => {
  event.preventDefault();
  enter($('token').value.trim());
  $('token').value = '';
};
addEventListener('hashchange', () => enter(tokenInAddress()));

const sentence = text => text && text[0].toUpperCase() + text.slice(1) + (/[.!?…]$/.test(text) ? '' : '.');

// ---------------------------------------------------------------- frames

async function watch() {
  while (!done) {
    try {
      if (generation === null) await refresh();
      await next();
    } catch (error) {
      if (done) break;
      const isRefused = error instanceof Refused;
      notice(isRefused ? error.message : error.message + ' Trying again…');
      shown = generation = null;       // the program may have been started anew
      tellNothing();
      // A wrong token is not tried again: each time takes the program longer to answer.
      await (isRefused ? new Promise(go => { entered = go; }) : new Promise(go => setTimeout(go, 1000)));
      entered = null;
    }
  }
}

async function next() {
  const details = ['corners', 'keygraphs', 'votes'].some(k => $('show-' + k).checked);
  $('every').hidden = !details;
  const after = shown ? '&after=' + shown.number : '';
  const answer = await ask('frame?details=' + (details ? 1 : 0) + after);
  if (done) return;
  const arrived = performance.now();
  if (answer.status === 204) {
    tellNothing();
    return refresh();
  }
  const frame = await unpack(await answer.arrayBuffer());
  if (shown && shown.bitmap !== frozen?.bitmap) shown.bitmap.close();
  shown = frame;
  view.classList.remove('stale');
  notice('');
  if (!frozen) draw();
  arrivals = arrivals.filter(t => arrived - t < 3000).concat(arrived);
  latency = Number(answer.headers.get('x-age-ms')) + performance.now() - arrived;
  tell();
  if (generation !== shown.line.models || Number($('threshold').value) !== shown.line.threshold && !dragging) await refresh();
}

async function unpack(body) {
  const size = new DataView(body).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(body, 4, size)));
  let at = 4 + size;
  const take = bytes => body.slice(at, at += bytes);
  const jpeg = new Blob([take(header.jpeg)], { type: 'image/jpeg' });
  const full = at < body.byteLength;
  const points = (n, each) => Array.from(full ? new Int16Array(take(n * each * 4)) : [], v => v / 4);
  const { number, line, seen } = header, { width, height } = line;
  return { number, line, seen, width, height, jpeg, bitmap: await createImageBitmap(jpeg),
    corners: points(header.corners, 1), keygraphs: points(header.keygraphs, 3), votes: points(header.votes, 3) };
}

// ----------------------------------------------------------------- words

function rows(parent, items) { parent.replaceChildren(...items); }

function seenRow(name, text) {
  const swatch = element('i', { className: 'swatch' });
  swatch.style.background = colourOf(name);
  return element('li', {}, swatch, element('span', {}, name), element('small', {}, text));
}

const nothing = text => element('li', { className: 'dim' }, text);

function ago(ms) {
  const s = Math.round(ms / 1000);
  if (s < 1) return 'just now';
  if (s < 120) return s + ' s ago';
  if (s < 7200) return Math.round(s / 60) + ' min ago';
  return s < 172800 ? Math.round(s / 3600) + ' h ago' : Math.round(s / 86400) + ' days ago';
}

let told = 0;
const times = { searched: {}, followed: {} };    // of the last frame of each kind
function tell() {
  const now = performance.now(), line = shown.line;
  times[line.searched ? 'searched' : 'followed'] = line.time_ms;
  if (now - told < 250) return;          // words change four times a second at most
  told = now;
  const drawn = (arrivals.length - 1) * 1000 / Math.max(arrivals.at(-1) - arrivals[0], 1);
  $('speed').textContent = `${line.fps.toFixed(1)} frames/s, ${Math.max(drawn, 0).toFixed(1)} drawn, ${line.dropped} dropped, `
    + `${Math.round(latency)} ms from camera to screen`;
  tellSeen(line.detections, shown.seen);
  const cell = ms => element('td', {}, ms ? ms.toFixed(1) : '–');
  rows($('times'), Object.keys(line.time_ms).map(name => element('tr', {}, element('td', {}, name), cell(times.searched[name]), cell(times.followed[name]))));
}

// What is in view, with the best score of each object; then what was seen before, newest first.
function tellSeen(detections, seen) {
  const inView = new Map();
  for (const { object, score } of detections) {
    const { best = 0, count = 0 } = inView.get(object) || {};
    inView.set(object, { best: Math.max(best, score), count: count + 1 });
  }
  const none = $('models').children.length ? 'nothing' : 'nothing: no objects are known yet';
  const found = [...inView].map(([name, { best, count }]) => seenRow(name, (count > 1 ? `${count} times, ` : '') + 'score ' + best.toFixed(2)));
  rows($('seen'), found.length ? found : [nothing(none)]);
  const before = seen.filter(s => !inView.has(s.object));
  rows($('before'), before.map(s => seenRow(s.object, ago(s.ms))));
  $('earlier').hidden = !before.length;
  const spoken = 'In view: ' + ([...inView.keys()].join(', ') || 'nothing');
  if ($('spoken').textContent !== spoken) $('spoken').textContent = spoken;
}

// No frame arrives: nobody knows what is in view.
function tellNothing() {
  rows($('seen'), [nothing('unknown: there is no picture')]);
  $('earlier').hidden = true;
  $('spoken').textContent = '';
  $('speed').textContent = 'no frames';
  if (!frozen) view.classList.add('stale');
}

function notice(text) { if ($('notice').textContent !== (done || text)) $('notice').textContent = done || text; }

// Answers to what the user does, beside what was used.
function say(text, bad) {
  const place = $(frozen ? 'problem' : 'said'), other = $(frozen ? 'said' : 'problem');
  other.textContent = '';
  place.textContent = text;
  place.className = bad ? 'bad' : 'dim';
}

async function refresh() {
  const status = await (await ask('status')).json();
  generation = status.generation;
  $('source').textContent = status.source.split('/').pop();
  notice(status.trouble || (shown ? '' : 'Waiting for the first frame…'));
  if (!dragging) { $('threshold').value = status.threshold; $('least').textContent = status.threshold.toFixed(2); }
  if (status.errand && !errand) {
    errand = status.errand;
    say(`Hold the object up, press "Learn from the camera" and mark its outline: its model becomes ${errand.output}.`);
  }
  objects = status.models.flatMap(m => m.objects.map(o => o.name));
  rows($('models'), status.models.map(model => {
    const save = element('button', { title: 'Save this model as a file' }, 'Save');
    save.onclick = attempt(async () => offer(await (await ask('models/' + model.id)).blob(), model.name + '.kgm'));
    const remove = element('button', { title: 'Stop finding the objects of this model' }, 'Remove');
    remove.onclick = attempt(async () => {
      // The second press within a few seconds counts.
      if (remove.textContent === 'Remove') {
        remove.textContent = 'Really?';
        say(model.file ? `Press again to remove ${model.name} and delete its file ${model.file}.` : `Press again to remove ${model.name}.`);
        return setTimeout(() => { remove.textContent = 'Remove'; }, 5000);
      }
      await ask('models/' + model.id, { method: 'DELETE' });
      await refresh();
      say(model.name + ' removed.');
    });
    const names = model.objects.map(o => o.name).join(', '), size = (model.bytes / 1e6).toFixed(1) + ' MB';
    const note = model.ordered ? size + ', ordered through the broker' : model.file ? size + ', kept' : size;
    return element('li', {}, element('span', {}, names, ' ', element('small', {}, note)), save, ...model.ordered ? [] : [remove]);
  }));
}

function offer(blob, name) {
  const link = element('a', { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

// -------------------------------------------------------------- controls

async function load(files) {
  for (const file of files) {
    await ask('models?name=' + encodeURIComponent(file.name.replace(/\.kgm$/i, '')), { method: 'POST', body: file });
  }
  await refresh();
  say('Loaded.');
}

$('load').onchange = attempt(async () => {
  const files = [...$('load').files];
  $('load').value = '';
  await load(files);
});
$('threshold').oninput = () => { dragging = true; $('least').textContent = Number($('threshold').value).toFixed(2); };
$('threshold').onchange = attempt(async () => {
  try { await ask('threshold?value=' + $('threshold').value, { method: 'PUT' }); } finally { dragging = false; }
});
$('snapshot').onclick = () => shown && view.toBlob(blob => offer(blob, `keygraph-${shown.number}.png`));
document.onkeydown = event => {
  if (event.key === 'Escape') return stopLearning();
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches('input[type=text], input[type=password]')) return;
  if (frozen) return;
  const box = { o: 'outlines', c: 'corners', t: 'keygraphs', v: 'votes' }[event.key];
  if (box) $('show-' + box).click();
  if (event.key === 's') $('snapshot').click();
  if (event.key === 'l') { event.preventDefault(); learnFromCamera(); }
};
// All scripts have run then.
document.addEventListener('DOMContentLoaded', watch);
