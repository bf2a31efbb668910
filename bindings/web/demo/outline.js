// Four corners that are dragged over a picture, by pointer or by keys.
//
// In: the canvas that shows the picture, and an element above it for the corners. Out: the outline, picture px,
// from the object's top left clockwise.

const STEP = 0.004; // Of the picture's longer side, for one press of an arrow key.
const NAMES = ["top left", "top right", "bottom right", "bottom left"];

export class Outline {
  #canvas;
  #marks;
  #points = [];
  #changed;

  /** `changed` is called after each move. */
  constructor(canvas, parent, changed) {
    this.#canvas = canvas;
    this.#changed = changed;
    this.#marks = NAMES.map((name, i) => {
      const mark = document.createElement("button");
      Object.assign(mark, { type: "button", className: "corner", textContent: i + 1, ariaLabel: `Corner ${i + 1}: ${name}` });
      mark.onpointerdown = (event) => mark.setPointerCapture(event.pointerId);
      mark.onpointermove = (event) => {
        if (mark.hasPointerCapture(event.pointerId)) this.#move(i, this.#pointOf(event));
      };
      mark.onkeydown = (event) => {
        const [x, y] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key] ?? [0, 0];
        if (!x && !y) return;
        event.preventDefault();
        const step = Math.max(canvas.width, canvas.height) * STEP * (event.shiftKey ? 10 : 1);
        this.#move(i, [this.#points[i][0] + x * step, this.#points[i][1] + y * step]);
      };
      return mark;
    });
    parent.replaceChildren(...this.#marks);
  }

  /** Puts the corners onto those of the picture. */
  reset() {
    const [w, h] = [this.#canvas.width - 1, this.#canvas.height - 1];
    this.#points = [[0, 0], [w, 0], [w, h], [0, h]];
    this.#place();
  }

  /** The outline; null when it is that of the whole picture. */
  get points() {
    const { width, height } = this.#canvas;
    const far = ([x, y]) => Math.min(x, width - 1 - x) > 1 || Math.min(y, height - 1 - y) > 1;
    return this.#points.some(far) ? this.#points.map((p) => [...p]) : null;
  }

  /** Draws the outline onto the canvas, which shows the picture. */
  draw() {
    const context = this.#canvas.getContext("2d");
    context.beginPath();
    this.#points.forEach(([x, y], i) => context[i ? "lineTo" : "moveTo"](x + 0.5, y + 0.5));
    context.closePath();
    context.lineWidth = Math.max(this.#canvas.width / 250, 1.5);
    context.strokeStyle = "#4cc2ff";
    context.stroke();
  }

  #pointOf(event) {
    const box = this.#canvas.getBoundingClientRect();
    const scale = this.#canvas.width / box.width;
    return [(event.clientX - box.left) * scale - 0.5, (event.clientY - box.top) * scale - 0.5];
  }

  #move(i, [x, y]) {
    const clamp = (v, most) => Math.min(Math.max(v, 0), most - 1);
    this.#points[i] = [clamp(x, this.#canvas.width), clamp(y, this.#canvas.height)];
    this.#place();
    this.#changed();
  }

  #place() {
    this.#marks.forEach((mark, i) => {
      mark.style.left = `${((this.#points[i][0] + 0.5) / this.#canvas.width) * 100}%`;
      mark.style.top = `${((this.#points[i][1] + 0.5) / this.#canvas.height) * 100}%`;
    });
  }
}
