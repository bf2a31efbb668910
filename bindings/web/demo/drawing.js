// What is found, drawn over a frame.
//
// In: a canvas, the frame, the line of the frame (docs/detection.md). Out: the canvas.

const COLOURS = ["#4cc2ff", "#ffb000", "#78e08f", "#ff7eb6", "#b79cff", "#f4f072", "#ff8a65", "#5eead4"];
const names = [];

/** The colour of an object, the same on the whole page. */
export function colourOf(name) {
  if (!names.includes(name)) names.push(name);
  return COLOURS[names.indexOf(name) % COLOURS.length];
}

/** Draws a frame and what was found in it. */
export function draw(canvas, frame, line, { triangles, votes }) {
  const { width, height } = frame;
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const context = canvas.getContext("2d");
  context.drawImage(frame, 0, 0);
  if (!line) return;
  const unit = width / 640; // The canvas is shown as wide as its column.
  const path = (points, n) => {
    context.beginPath();
    for (let i = 0; i + 2 * n <= points.length; i += 2 * n) {
      for (let k = 0; k < n; k++) context[k ? "lineTo" : "moveTo"](points[i + 2 * k] + 0.5, points[i + 2 * k + 1] + 0.5);
      context.closePath();
    }
    context.stroke();
  };
  const stroke = (colour, wide) => Object.assign(context, { strokeStyle: colour, lineWidth: wide * unit });
  context.lineJoin = "round";
  if (triangles && line.details) {
    stroke("#ffffff50", 0.75);
    path(line.details.keygraphs, 3);
  }
  if (votes && line.details) {
    stroke("#78e08f", 1);
    path(line.details.votes, 3);
  }
  for (const found of line.detections) {
    const outline = found.surface ? border(found.surface) : found.corners;
    if (found.surface) {
      stroke(`${colourOf(found.object)}a0`, 1);
      path(cells(found.surface), 4);
    }
    stroke("#000a", 6);
    path(outline.flat(), outline.length);
    stroke(colourOf(found.object), 3);
    path(outline.flat(), outline.length);
  }
  for (const found of line.detections) label(context, found, unit);
}

/** The border of a surface, from the picture's top left clockwise. */
function border({ cols, rows, points }) {
  const at = (i, j) => points[j * cols + i];
  const along = (n, of) => Array.from({ length: n - 1 }, (_, k) => of(k));
  return [
    ...along(cols, (k) => at(k, 0)),
    ...along(rows, (k) => at(cols - 1, k)),
    ...along(cols, (k) => at(cols - 1 - k, rows - 1)),
    ...along(rows, (k) => at(0, rows - 1 - k)),
  ];
}

/** The corners of the cells of a surface. */
function cells({ cols, rows, points }) {
  const corners = [];
  for (let j = 0; j + 1 < rows; j++) {
    for (let i = 0; i + 1 < cols; i++) {
      for (const [x, y] of [[0, 0], [1, 0], [1, 1], [0, 1]]) corners.push(...points[(j + y) * cols + i + x]);
    }
  }
  return corners;
}

function label(context, found, unit) {
  const { width, height } = context.canvas;
  const text = `${found.object}  ${found.score.toFixed(2)}`;
  context.font = `600 ${15 * unit}px system-ui, sans-serif`;
  const [wide, high] = [context.measureText(text).width + 14 * unit, 24 * unit];
  const top = found.corners.reduce((a, b) => (b[1] < a[1] ? b : a));
  const x = Math.min(Math.max(top[0] - wide / 2, 0), Math.max(width - wide, 0));
  const y = Math.min(Math.max(top[1] - high - 5 * unit, 0), height - high);
  context.fillStyle = colourOf(found.object);
  context.fillRect(x, y, wide, high);
  context.fillStyle = "#000";
  context.fillText(text, x + 7 * unit, y + 17 * unit);
}
