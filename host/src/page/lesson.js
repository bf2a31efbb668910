'use strict';
// Learning an object: from a frame of the camera in which it is marked, or from a picture of it.

// What the program takes (see src/camera/web.rs and intake.rs). Other pictures are made smaller here.
const MOST_BYTES = 16 * 2 ** 20, MOST_PIXELS = 12.5e6, TAKEN = ['image/jpeg', 'image/png', 'image/webp', 'image/gif', 'image/bmp'];
const MADE_PIXELS = 4e6, LARGEST_FILE = 100e6;
const NAME_BYTES = 32;
const hasPointer = matchMedia('(hover: hover) and (pointer: fine)');

const marks = [0, 1, 2, 3].map(i => element('button', { className: 'corner', type: 'button', ariaLabel: `Corner ${i + 1} of the outline` }, String(i + 1)));
$('corners').append(...marks);
let outline = [];            // the corners of the object, px of what is learned from

// ------------------------------------------------------------- the outline

function drawOutline(scale) {
  if (!frozen.marked) return;
  const ratio = devicePixelRatio || 1;
  context.beginPath();
  outline.forEach(([x, y], i) => context[i ? 'lineTo' : 'moveTo']((x + .5) * scale, (y + .5) * scale));
  context.closePath();
  context.fillStyle = '#4cc2ff20'; context.fill();
  context.lineWidth = 2 * ratio; context.strokeStyle = '#4cc2ff'; context.stroke();
  marks.forEach((mark, i) => {
    mark.style.left = (outline[i][0] + .5) * scale / ratio + 'px';
    mark.style.top = (outline[i][1] + .5) * scale / ratio + 'px';
  });
}

function move(i, x, y) {
  const { width, height } = frozen;
  outline[i] = [Math.min(Math.max(x, 0), width - 1), Math.min(Math.max(y, 0), height - 1)];
  draw();
}

marks.forEach((mark, i) => {
  mark.onpointerdown = event => mark.setPointerCapture(event.pointerId);
  mark.onpointermove = event => {
    if (!mark.hasPointerCapture(event.pointerId)) return;
    const box = view.getBoundingClientRect(), scale = frozen.width / box.width;
    move(i, (event.clientX - box.left) * scale - .5, (event.clientY - box.top) * scale - .5);
  };
  mark.onkeydown = event => {
    const [dx, dy] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key] || [0, 0];
    if (!dx && !dy) return;
    event.preventDefault();
    const step = event.shiftKey ? 10 : 1;
    move(i, outline[i][0] + step * dx, outline[i][1] + step * dy);
  };
});

// -------------------------------------------------------- what to learn from

// `subject`: {bitmap, width, height, bytes, from: 'camera' or 'picture', marked: whether by its corners}.
function startLearning(subject) {
  dropBitmap();
  frozen = subject;
  const { width: w, height: h } = frozen;
  outline = [[.25, .2], [.75, .2], [.75, .8], [.25, .8]].map(([x, y]) => [x * w, y * h]);
  document.body.classList.add('learning');
  $('lesson').hidden = false;
  $('choice').hidden = subject.from === 'camera';
  $('part').checked = subject.marked;
  view.ariaLabel = 'Picture to learn from';
  say('');
  tellTask();
}

// What is to be done now.
function tellTask() {
  $('corners').hidden = !frozen.marked;
  const drag = 'Drag the corners onto the corners of the object: 1 at its top left, then clockwise.';
  const keys = element('span', { className: 'keys' }, ' Arrow keys move the corner in focus.');
  if (frozen.marked) $('task').replaceChildren(drag, keys);
  else $('task').replaceChildren('The whole picture is learned. It should show the object from the front and nothing else.');
  draw();
}

function dropBitmap() {
  if (frozen && frozen.bitmap !== shown?.bitmap) frozen.bitmap.close();
}

function stopLearning() {
  if (!frozen) return;
  dropBitmap();
  frozen = null;
  document.body.classList.remove('learning');
  $('lesson').hidden = $('corners').hidden = true;
  $('problem').textContent = '';
  view.ariaLabel = 'Picture of the camera';
  if (!shown) context.clearRect(0, 0, view.width, view.height);
  draw();
}

function learnFromCamera() {
  if (frozen) return;
  if (!shown) return say('There is no picture from the camera yet.', true);
  const { bitmap, width, height, jpeg } = shown;
  $('name').value = errand ? errand.name : '';
  startLearning({ bitmap, width, height, bytes: jpeg, from: 'camera', marked: true });
  marks[0].focus();
}

async function learnFromPicture(file) {
  const name = file.name, megabytes = bytes => Math.round(bytes / 1e6) + ' MB';
  if (file.size > LARGEST_FILE) throw new Error(`${name} is too large: it has ${megabytes(file.size)}, and at most ${megabytes(LARGEST_FILE)} are read.`);
  let bitmap = await createImageBitmap(file).catch(() => null);
  if (!bitmap) throw new Error(`${name} is not a picture that this browser can show, or it is damaged: take a JPEG, PNG or WebP picture.`);
  let bytes = file;
  if (!TAKEN.includes(file.type) || file.size > MOST_BYTES || bitmap.width * bitmap.height > MOST_PIXELS) {
    const scale = Math.min(1, Math.sqrt(MADE_PIXELS / (bitmap.width * bitmap.height)));
    const canvas = element('canvas', { width: Math.max(1, Math.round(bitmap.width * scale)), height: Math.max(1, Math.round(bitmap.height * scale)) });
    const smaller = canvas.getContext('2d');
    smaller.fillStyle = '#fff';
    smaller.fillRect(0, 0, canvas.width, canvas.height);
    smaller.imageSmoothingQuality = 'high';
    smaller.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
    bitmap.close();
    bitmap = await createImageBitmap(canvas);
    bytes = await new Promise(take => canvas.toBlob(take, 'image/jpeg', .92));
  }
  $('name').value = errand ? errand.name : nameOf(name);
  startLearning({ bitmap, width: bitmap.width, height: bitmap.height, bytes, from: 'picture', marked: false });
  if (hasPointer.matches) { $('name').focus(); $('name').select(); }
}

// The name of a file without its extension, as long as names may be.
function nameOf(file) {
  let name = file.replace(/\.[^.]*$/, '').trim();
  while (new TextEncoder().encode(name).length > NAME_BYTES) name = [...name].slice(0, -1).join('');
  return name;
}

$('part').onchange = () => {
  frozen.marked = $('part').checked;
  tellTask();
  if (frozen.marked) marks[0].focus();
};
$('learn').onclick = learnFromCamera;
$('choose').onchange = attempt(async () => {
  const [file] = $('choose').files;
  $('choose').value = '';              // the same file may be chosen again
  if (file) await learnFromPicture(file);
});
$('cancel').onclick = () => { stopLearning(); $('learn').focus(); };

// A picture or a model that is dropped anywhere on the page.
const carriesFiles = event => [...event.dataTransfer?.types || []].includes('Files');
addEventListener('dragover', event => {
  if (!carriesFiles(event)) return;
  event.preventDefault();
  $('drop').hidden = false;
});
addEventListener('dragleave', event => { if (!event.relatedTarget) $('drop').hidden = true; });
const takeDropped = attempt(async event => {
  $('drop').hidden = true;
  const [file] = event.dataTransfer.files;
  if (/\.kgm$/i.test(file.name)) await load([file]);
  else await learnFromPicture(file);
});
addEventListener('drop', event => { if (carriesFiles(event)) takeDropped(event); });

// ---------------------------------------------------------------- training

$('lesson').onsubmit = attempt(async () => {
  const name = $('name').value.trim(), subject = frozen;
  const corners = subject.marked ? '&corners=' + outline.flat().map(v => v.toFixed(2)).join(',') : '';
  say('Training…');
  $('train').disabled = true;
  try {
    const path = `learn?name=${encodeURIComponent(name)}${corners}&from=${subject.from}`;
    const learned = await (await ask(path, { method: 'POST', body: subject.bytes })).json();
    stopLearning();
    if (learned.id === null) done = `${name} was saved as ${learned.file}. The program has ended; this page can be closed.`;
    notice('');
    if (!done) await refresh();
    if (learned.found === null) say(`${name} was learned but not found in its own picture: take a larger or sharper one, or a part with more texture.`, true);
    else if (learned.warning) say(`${name} was learned, but its picture ${learned.warning}.`, true);
    else say(`${name} learned: ${learned.keygraphs} keygraphs. ${learned.file ? 'Kept as ' + learned.file + '.' : 'Save it to keep it.'}`);
    $('name').value = '';
  } finally { $('train').disabled = false; }
});

// A keyboard on the screen takes room, and may move the page.
function fit() {
  const style = document.documentElement.style;
  style.setProperty('--high', visualViewport.height + 'px');
  style.setProperty('--top', visualViewport.offsetTop + 'px');
}
if (window.visualViewport) {
  visualViewport.addEventListener('resize', fit);
  visualViewport.addEventListener('scroll', fit);
  fit();
}
