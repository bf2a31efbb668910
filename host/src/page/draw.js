'use strict';
// The canvas: a frame and what is found in it, or the picture that is being learned from.

function draw() {
  const frame = frozen || shown;
  if (!frame) return;
  const { width, height } = frame, ratio = devicePixelRatio || 1;
  // As large as its column and the window allow, in whole device pixels. What is learned leaves
  // room for the corners that are dragged.
  const edge = frozen ? 48 : 0;
  const high = frozen ? $('stage').clientHeight - edge : Math.max(innerHeight - 24, 240);
  const room = Math.max(Math.min($('stage').clientWidth - edge, high * width / height), 48);
  const w = Math.round(room * ratio), h = Math.round(w * height / width);
  if (view.width !== w || view.height !== h) { view.width = w; view.height = h; view.style.width = w / ratio + 'px'; }
  const scale = w / width;
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.fillStyle = '#fff';            // behind what is transparent, as it is learned
  if (frozen) context.fillRect(0, 0, w, h);
  context.drawImage(frame.bitmap, 0, 0, w, h);
  if (frozen) return drawOutline(scale);
  // Pixel centres are at whole coordinates: half a pixel to the canvas, whose are not.
  const X = x => (x + .5) * scale;
  const path = (points, n) => {
    context.beginPath();
    for (let i = 0; i + 2 * n <= points.length; i += 2 * n) {
      for (let k = 0; k < n; k++) context[k ? 'lineTo' : 'moveTo'](X(points[i + 2 * k]), X(points[i + 2 * k + 1]));
      context.closePath();
    }
    context.stroke();
  };
  context.lineJoin = 'round';
  if ($('show-keygraphs').checked) { context.strokeStyle = '#ffffff50'; context.lineWidth = ratio * .75; path(frame.keygraphs, 3); }
  if ($('show-votes').checked) { context.strokeStyle = '#78e08f'; context.lineWidth = ratio; path(frame.votes, 3); }
  if ($('show-corners').checked) {
    context.fillStyle = '#ffb000';
    for (let i = 0; i < frame.corners.length; i += 2) {
      context.beginPath();
      context.arc(X(frame.corners[i]), X(frame.corners[i + 1]), 2 * ratio, 0, 7);
      context.fill();
    }
  }
  if (!$('show-outlines').checked) return;
  // What is searched, if that is a part.
  if (frame.line.roi) {
    const [x, y, wide, high] = frame.line.roi;
    context.strokeStyle = '#c8c8c8'; context.lineWidth = ratio;
    path([x, y, x + wide - 1, y, x + wide - 1, y + high - 1, x, y + high - 1], 4);
  }
  // Where it was when it was last seen.
  context.setLineDash([6 * ratio, 6 * ratio]);
  for (const lost of frame.line.lost) {
    context.strokeStyle = colourOf(lost.object) + '90'; context.lineWidth = 1.5 * ratio; path(lost.corners.flat(), 4);
  }
  context.setLineDash([]);
  for (const found of frame.line.detections) {
    const colour = colourOf(found.object), points = (found.surface ? border(found.surface) : found.corners).flat();
    if (found.surface) { context.strokeStyle = colour + 'a0'; context.lineWidth = ratio; path(cells(found.surface), 4); }
    context.strokeStyle = '#000a'; context.lineWidth = 5 * ratio; path(points, points.length / 2);
    context.strokeStyle = colour; context.lineWidth = 2.5 * ratio; path(points, points.length / 2);
  }
  // Axes in space: right, down and into the picture.
  for (const { axes } of frame.line.detections) {
    for (const [i, colour] of [[1, '#ff5046'], [2, '#40dc50'], [3, '#4696ff']]) {
      if (axes) { context.strokeStyle = colour; context.lineWidth = 2 * ratio; path([axes[0], axes[i]].flat(), 2); }
    }
  }
  for (const lost of frame.line.lost) label(lost, X, ratio, w, h);
  for (const found of frame.line.detections) label(found, X, ratio, w, h);
}

// A surface is a grid of points, row by row: its border from the top left clockwise, and its cells.
function border({ cols, rows, points }) {
  const at = (i, j) => points[j * cols + i], along = (n, of) => Array.from({ length: n - 1 }, (_, k) => of(k));
  return [...along(cols, k => at(k, 0)), ...along(rows, k => at(cols - 1, k)),
    ...along(cols, k => at(cols - 1 - k, rows - 1)), ...along(rows, k => at(0, rows - 1 - k))];
}

function cells({ cols, rows, points }) {
  const corners = [];
  for (let j = 0; j + 1 < rows; j++) {
    for (let i = 0; i + 1 < cols; i++) corners.push(...[[0, 0], [1, 0], [1, 1], [0, 1]].flatMap(([x, y]) => points[(j + y) * cols + i + x]));
  }
  return corners;
}

function label(found, X, ratio, w, h) {
  const isLost = found.state === 'lost';
  const text = isLost ? `${found.object}  lost` : `${found.object}  ${found.score.toFixed(2)}  ${found.state}`;
  context.font = `600 ${13 * ratio}px system-ui, sans-serif`;
  const wide = context.measureText(text).width + 12 * ratio, high = 20 * ratio;
  const top = found.corners.reduce((a, b) => b[1] < a[1] ? b : a);
  const x = Math.min(Math.max(X(top[0]) - wide / 2, 0), w - wide), y = Math.min(Math.max(X(top[1]) - high - 4 * ratio, 0), h - high);
  context.fillStyle = isLost ? '#000a' : colourOf(found.object);
  context.fillRect(x, y, wide, high);
  context.fillStyle = isLost ? colourOf(found.object) : '#000';
  context.fillText(text, x + 6 * ratio, y + 14.5 * ratio);
}

function colourOf(name) {
  if (!objects.includes(name)) objects.push(name);
  return COLOURS[objects.indexOf(name) % COLOURS.length];
}

document.querySelectorAll('.check input').forEach(box => box.addEventListener('change', draw));
addEventListener('resize', draw);
new ResizeObserver(draw).observe($('stage'));       // a scroll bar that comes, too
