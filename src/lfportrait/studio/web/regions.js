// What is hair, hat, neck, skin or background in a painting: one number a pixel, painted by a brush.

const KEPT = 60; // strokes that can be undone
export const COLORS = [null, [224, 92, 190], [80, 150, 245], [70, 190, 120], [245, 166, 60], [140, 140, 150]];

/** Labels of a picture, what of them is painted by hand, and its past. */
export class Regions {
  /**
   * @param {number[]} size Width and height in pixels.
   * @param {Uint8Array} found What the detector sees, a label a pixel.
   * @param {Uint8Array|null} painted By hand; 0 leaves what was found.
   */
  constructor([width, height], found, painted) {
    this.size = [width, height];
    this.found = found;
    this.painted = painted ?? new Uint8Array(width * height);
    this.past = [];
    this.future = [];
    this.listeners = [];
    this.canvas = new OffscreenCanvas(width, height);
    this.shown = new ImageData(width, height);
    this.dirty = [0, 0, width, height];
    this.draw();
  }

  watch(act) {
    this.listeners.push(act);
  }

  changed() {
    for (const act of this.listeners) act();
  }

  /** Begin a stroke: what was there is kept until all of it is undone. */
  begin() {
    this.before = this.painted.slice();
    this.touched = null;
  }

  /** A piece of a stroke, round and as wide as the brush, from one place to another. */
  line([x0, y0], [x1, y1], radius, label) {
    const [width, height] = this.size;
    const left = Math.max(0, Math.floor(Math.min(x0, x1) - radius)),
      right = Math.min(width - 1, Math.ceil(Math.max(x0, x1) + radius));
    const top = Math.max(0, Math.floor(Math.min(y0, y1) - radius)),
      bottom = Math.min(height - 1, Math.ceil(Math.max(y0, y1) + radius));
    const [dx, dy] = [x1 - x0, y1 - y0],
      long = dx * dx + dy * dy;
    for (let y = top; y <= bottom; y++) {
      for (let x = left; x <= right; x++) {
        const along = long ? Math.min(Math.max(((x - x0) * dx + (y - y0) * dy) / long, 0), 1) : 0;
        if ((x - x0 - along * dx) ** 2 + (y - y0 - along * dy) ** 2 <= radius * radius)
          this.painted[y * width + x] = label;
      }
    }
    this.soil(left, top, right + 1, bottom + 1);
    this.draw();
  }

  /** End a stroke. */
  end() {
    if (!this.before || !this.touched) return;
    this.past.push(this.piece(this.before, this.touched));
    if (this.past.length > KEPT) this.past.shift();
    this.future = [];
    this.before = null;
    this.changed();
  }

  /** A box of labels: the box, and a copy of what is in it. */
  piece(from, [left, top, right, bottom]) {
    const width = right - left,
      copy = new Uint8Array(width * (bottom - top));
    for (let y = top; y < bottom; y++)
      copy.set(from.subarray(y * this.size[0] + left, y * this.size[0] + right), (y - top) * width);
    return { box: [left, top, right, bottom], copy };
  }

  undo() {
    return this.turn(this.past, this.future);
  }

  redo() {
    return this.turn(this.future, this.past);
  }

  turn(from, to) {
    const step = from.pop();
    if (!step) return false;
    const [left, top, right, bottom] = step.box;
    to.push(this.piece(this.painted, step.box));
    for (let y = top; y < bottom; y++) {
      this.painted.set(
        step.copy.subarray((y - top) * (right - left), (y - top + 1) * (right - left)),
        y * this.size[0] + left,
      );
    }
    this.soil(...step.box);
    this.draw();
    this.changed();
    return true;
  }

  /** All that was painted away. */
  clear() {
    this.begin();
    this.painted.fill(0);
    this.soil(0, 0, ...this.size);
    this.draw();
    this.end();
  }

  soil(left, top, right, bottom) {
    const join = (box) =>
      box
        ? [Math.min(box[0], left), Math.min(box[1], top), Math.max(box[2], right), Math.max(box[3], bottom)]
        : [left, top, right, bottom];
    this.dirty = join(this.dirty);
    this.touched = join(this.touched);
  }

  /** The colored picture of the labels, where they have changed: found ones faint, painted ones strong. */
  draw() {
    if (!this.dirty) return;
    const [left, top, right, bottom] = this.dirty,
      [width] = this.size,
      { data } = this.shown;
    for (let y = top; y < bottom; y++) {
      for (let x = left; x < right; x++) {
        const at = y * width + x,
          hand = this.painted[at],
          color = COLORS[hand || this.found[at]];
        data[4 * at] = color ? color[0] : 0;
        data[4 * at + 1] = color ? color[1] : 0;
        data[4 * at + 2] = color ? color[2] : 0;
        data[4 * at + 3] = !color ? 0 : hand ? 165 : 70;
      }
    }
    this.canvas.getContext("2d").putImageData(this.shown, 0, 0, left, top, right - left, bottom - top);
    this.dirty = null;
  }

  /** The painted labels as a PNG file, red, green and blue the label. */
  async file() {
    const canvas = new OffscreenCanvas(...this.size);
    const image = new ImageData(...this.size);
    this.painted.forEach((label, at) => {
      image.data.set([label, label, label, 255], 4 * at);
    });
    canvas.getContext("2d").putImageData(image, 0, 0);
    return canvas.convertToBlob({ type: "image/png" });
  }
}

/** Labels of a stored picture, uint8 [width * height]. */
export function labelsOf(image, [width, height]) {
  const context = new OffscreenCanvas(width, height).getContext("2d");
  context.imageSmoothingEnabled = false;
  context.drawImage(image, 0, 0, width, height);
  const { data } = context.getImageData(0, 0, width, height);
  return Uint8Array.from({ length: width * height }, (_, at) => data[4 * at]);
}
