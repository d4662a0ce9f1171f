// A picture that can be enlarged and moved about under its drawings: wheel, pinch, keys, buttons.

import { h, sign } from "./dom.js";
import { t } from "./i18n.js";

const LARGEST = 40; // pixels of the window for one of the picture

export class Viewport {
  /**
   * @param {CanvasImageSource} picture
   * @param {number[]} size Its width and height in pixels.
   */
  constructor(picture, size) {
    this.picture = picture;
    this.size = size;
    this.canvas = h("canvas.picture", { "aria-hidden": "true" });
    this.element = h("div.viewport", this.canvas);
    this.layers = []; // drawn over the picture, in its pixels
    this.listeners = [];
    this.scale = 1;
    this.shift = [0, 0];
    this.pointers = new Map();
    this.element.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.element.addEventListener("pointerdown", (event) => this.down(event), true);
    this.element.addEventListener("pointermove", (event) => this.dragged(event), true);
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) {
      this.element.addEventListener(name, (event) => this.up(event), true);
    }
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(this.element);
  }

  close() {
    this.observer.disconnect();
    cancelAnimationFrame(this.frame);
  }

  /** Call `act` when the place of the picture in the window has changed. */
  watch(act) {
    this.listeners.push(act);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.element;
    if (!width || !height) return;
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    if (!this.touched) this.fit(this.box);
    else this.changed();
  }

  /** Show the whole picture, or a box [left, top, right, bottom] of it. */
  fit(box = null) {
    this.box = box;
    this.touched = false;
    const [left, top, right, bottom] = box ?? [0, 0, ...this.size];
    const { clientWidth: width, clientHeight: height } = this.element;
    this.scale = Math.min(width / (right - left), height / (bottom - top), LARGEST) * (box ? 1 : 0.97);
    this.shift = [
      width / 2 - (this.scale * (left + right)) / 2,
      height / 2 - (this.scale * (top + bottom)) / 2,
    ];
    this.changed();
  }

  /** Enlarge so that a place of the window, in pixels from the corner, stays where it is. */
  zoom(factor, place = [this.element.clientWidth / 2, this.element.clientHeight / 2]) {
    const least =
      0.5 * Math.min(this.element.clientWidth / this.size[0], this.element.clientHeight / this.size[1]);
    const scale = Math.min(Math.max(this.scale * factor, least), LARGEST);
    const ratio = scale / this.scale;
    this.shift = this.shift.map((value, k) => place[k] + (value - place[k]) * ratio);
    this.scale = scale;
    this.touched = true;
    this.changed();
  }

  pan(x, y) {
    // Some of the picture is always in sight.
    const room = [this.element.clientWidth, this.element.clientHeight];
    this.shift = [x, y].map((by, k) =>
      Math.min(Math.max(this.shift[k] + by, 40 - this.scale * this.size[k]), room[k] - 40),
    );
    this.touched = true;
    this.changed();
  }

  /** Bring a place of the picture into sight. */
  reveal(point) {
    const [x, y] = this.outside(point);
    const room = [this.element.clientWidth, this.element.clientHeight];
    const by = [x, y].map((value, k) =>
      value < 24 ? 24 - value : value > room[k] - 24 ? room[k] - 24 - value : 0,
    );
    if (by[0] || by[1]) this.pan(...by);
  }

  /** Place in the window of a place in the picture; pixels' middles lie at .5 there. */
  outside([x, y]) {
    return [this.shift[0] + this.scale * (x + 0.5), this.shift[1] + this.scale * (y + 0.5)];
  }

  /** Place in the picture of a pointer. */
  inside(event) {
    const box = this.element.getBoundingClientRect();
    return [
      (event.clientX - box.left - this.shift[0]) / this.scale - 0.5,
      (event.clientY - box.top - this.shift[1]) / this.scale - 0.5,
    ];
  }

  changed() {
    for (const act of this.listeners) act();
    this.draw();
  }

  draw() {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = null;
      const ratio = window.devicePixelRatio || 1;
      const context = this.canvas.getContext("2d");
      context.setTransform(1, 0, 0, 1, 0, 0);
      context.clearRect(0, 0, this.canvas.width, this.canvas.height);
      context.setTransform(
        this.scale * ratio,
        0,
        0,
        this.scale * ratio,
        this.shift[0] * ratio,
        this.shift[1] * ratio,
      );
      context.imageSmoothingEnabled = this.scale < 3;
      context.imageSmoothingQuality = "high";
      context.drawImage(this.picture, 0, 0, ...this.size);
      for (const layer of this.layers) layer(context);
    });
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 24 : event.deltaMode === 2 ? 400 : 1;
    const box = this.element.getBoundingClientRect();
    const factor = Math.exp(-Math.min(Math.max(event.deltaY * lines, -300), 300) * 0.0025);
    this.zoom(factor, [event.clientX - box.left, event.clientY - box.top]);
  }

  down(event) {
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    const hands = this.pointers.size > 1;
    // The middle button, or the left one on what is nothing else's; two fingers always.
    const ours = hands || event.button === 1 || !this.taken?.(event);
    if (hands) this.element.dispatchEvent(new CustomEvent("pinch"));
    if (!ours) return;
    event.stopPropagation();
    if (event.button === 1) event.preventDefault();
    this.held = true;
    this.element.setPointerCapture(event.pointerId);
    this.element.classList.add("held");
  }

  dragged(event) {
    const old = this.pointers.get(event.pointerId);
    if (!old || !this.held) return;
    event.stopPropagation();
    const before = this.spread();
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    const share = 1 / this.pointers.size;
    this.pan((event.clientX - old[0]) * share, (event.clientY - old[1]) * share);
    if (!before) return;
    const box = this.element.getBoundingClientRect();
    const places = [...this.pointers.values()];
    const middle = [0, 1].map((k) => places.reduce((sum, place) => sum + place[k], 0) / places.length);
    this.zoom(this.spread() / before, [middle[0] - box.left, middle[1] - box.top]);
  }

  spread() {
    if (this.pointers.size < 2) return 0;
    const [one, other] = [...this.pointers.values()];
    return Math.max(Math.hypot(one[0] - other[0], one[1] - other[1]), 1);
  }

  up(event) {
    this.pointers.delete(event.pointerId);
    if (this.pointers.size) return;
    this.held = false;
    this.element.classList.remove("held");
  }

  /** Buttons for those who have no wheel. */
  buttons() {
    return h(
      "div.zoom",
      { role: "group", "aria-label": t("view.zoom") },
      sign("plus", t("view.closer"), () => this.zoom(1.4)),
      sign("minus", t("view.further"), () => this.zoom(1 / 1.4)),
      sign("fit", t("view.whole"), () => this.fit()),
    );
  }
}
