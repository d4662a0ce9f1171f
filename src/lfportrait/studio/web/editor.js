// The landmark editor: points and lines over a painting, a loupe, hands and keys.

import { h, segments, sign } from "./dom.js";
import { t } from "./i18n.js";
import { LINES, moving, partOf } from "./landmarks.js";
import { say } from "./shell.js";
import { Viewport } from "./viewport.js";

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const GRIP = 18; // pixels of the window within which a hand takes a point
const LOUPE = 152; // width of the loupe in pixels of the window
const CLOSER = 5; // how much larger than the picture's pixels it shows, at least

export class LandmarkEditor {
  /**
   * @param {CanvasImageSource} picture
   * @param {Landmarks} landmarks
   * @param {object} how `onreset` is asked for the points that were found at first.
   */
  constructor(picture, landmarks, { onreset }) {
    this.landmarks = landmarks;
    this.reach = "point";
    this.chosen = null;
    this.view = new Viewport(picture, landmarks.size);
    this.view.element.setAttribute("role", "group");
    this.view.element.setAttribute("aria-label", t("editor.picture"));
    this.drawing = h("svg:svg.points", { "aria-hidden": "false" });
    this.paths = LINES.map(() => h("svg:path", { "aria-hidden": "true" }));
    this.marks = landmarks.points.map((_, number) => this.mark(number));
    this.drawing.append(...this.paths, ...this.marks);
    this.loupe = h("canvas.loupe", { hidden: true, "aria-hidden": "true" });
    this.view.element.append(this.drawing, this.loupe, this.view.buttons());
    this.view.taken = (event) => event.button === 0 && this.nearest(event) !== null;
    this.view.element.addEventListener("pointerdown", (event) => this.down(event));
    this.view.element.addEventListener("pinch", () => this.release());
    this.element = h(
      "div.editor",
      this.tools(onreset),
      this.view.element,
      h("p.small.soft.hint", t("editor.hint")),
    );
    this.element.addEventListener("keydown", (event) => this.shortcut(event));
    landmarks.watch(() => this.draw());
    this.view.watch(() => this.draw());
    this.frameFace();
  }

  close() {
    this.view.close();
  }

  /** Show the face with some room about it. */
  frameFace() {
    const [xs, ys] = [0, 1].map((k) => this.landmarks.points.map((point) => point[k]));
    const room = 0.28 * Math.max(Math.max(...xs) - Math.min(...xs), Math.max(...ys) - Math.min(...ys));
    this.view.box = [
      Math.min(...xs) - room,
      Math.min(...ys) - room,
      Math.max(...xs) + room,
      Math.max(...ys) + room,
    ];
  }

  tools(onreset) {
    this.back = sign("undo", t("editor.undo"), () => this.landmarks.undo());
    this.again = sign("redo", t("editor.redo"), () => this.landmarks.redo());
    this.fold = sign("mirror", t("editor.mirror"), () => this.mirror());
    const reset = sign("reset", t("editor.reset"), onreset);
    this.reaches = segments(
      t("editor.moves"),
      [
        ["point", t("editor.point")],
        ["part", t("editor.part")],
        ["face", t("editor.face")],
      ],
      this.reach,
      (reach) => this.setReach(reach),
    );
    this.spoken = h("output.spoken.small", t("editor.none"));
    return h(
      "div.tools",
      { role: "toolbar", "aria-label": t("editor.tools") },
      this.reaches,
      this.back,
      this.again,
      this.fold,
      reset,
      this.spoken,
    );
  }

  setReach(reach) {
    this.reach = reach;
    this.reaches.show(reach);
    this.draw();
  }

  mark(number) {
    const mark = h("svg:g.mark", {
      tabindex: 0,
      role: "button",
      "data-number": number,
      onfocus: () => this.choose(number),
      onblur: () => {
        this.loupe.hidden = true;
      },
      onkeydown: (event) => this.key(event, number),
    });
    // Two rings, so that it is seen on light paint and on dark.
    mark.append(h("svg:circle.halo", { r: 5.5 }), h("svg:circle.dot", { r: 3.6 }));
    return mark;
  }

  choose(number) {
    this.chosen = number;
    this.view.reveal(this.landmarks.points[number]);
    this.landmarks.close();
    this.draw();
    this.magnify();
  }

  /** Number of the point under a pointer, or null. */
  nearest(event) {
    if (event.target.closest?.("button")) return null;
    const [x, y] = this.view.inside(event);
    let best = null,
      least = GRIP / this.view.scale;
    this.landmarks.points.forEach((point, number) => {
      const far = Math.hypot(point[0] - x, point[1] - y);
      if (far < least) [best, least] = [number, far];
    });
    return best;
  }

  down(event) {
    const number = this.nearest(event);
    if (number === null || this.view.held) return;
    event.preventDefault();
    this.marks[number].focus({ preventScroll: true });
    const start = this.view.inside(event);
    // The point keeps its distance from the hand: it doesn't jump when it is taken.
    let done = [0, 0],
      moved = false;
    const drag = (next) => {
      const now = this.view.inside(next);
      if (!moved) this.landmarks.step(null);
      moved = true;
      const by = this.landmarks.move(
        moving(number, this.reach),
        [0, 1].map((k) => now[k] - start[k] - done[k]),
      );
      done = done.map((value, k) => value + by[k]);
      this.magnify(next);
    };
    const { element } = this.view;
    element.setPointerCapture(event.pointerId);
    this.release = () => {
      element.removeEventListener("pointermove", drag);
      for (const name of ["pointerup", "pointercancel"]) element.removeEventListener(name, this.release);
      this.landmarks.close();
      this.loupe.hidden = true;
      this.release = () => {};
    };
    element.addEventListener("pointermove", drag);
    for (const name of ["pointerup", "pointercancel"]) element.addEventListener(name, this.release);
    this.magnify(event);
  }

  release() {}

  key(event, number) {
    const arrow = ARROWS[event.key];
    if (!arrow || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const by = arrow.map((value) => value * (event.shiftKey ? 10 : 1));
    this.landmarks.step(`keys ${number} ${this.reach}`);
    this.landmarks.move(moving(number, this.reach), by);
    this.view.reveal(this.landmarks.points[number]);
    this.magnify();
  }

  shortcut(event) {
    const control = event.ctrlKey || event.metaKey;
    const key = event.key.toLowerCase();
    if (control && key === "z") {
      event.preventDefault();
      if (event.shiftKey) this.landmarks.redo();
      else this.landmarks.undo();
    } else if (control && key === "y") {
      event.preventDefault();
      this.landmarks.redo();
    } else if (!control && !event.altKey) {
      const reach = { 1: "point", 2: "part", 3: "face" }[key];
      if (reach) this.setReach(reach);
      else if (key === "m") this.mirror();
      else if (key === "+" || key === "=") this.view.zoom(1.4, this.focused());
      else if (key === "-") this.view.zoom(1 / 1.4, this.focused());
      else if (key === "0") this.view.fit();
    }
  }

  focused() {
    return this.chosen === null ? undefined : this.view.outside(this.landmarks.points[this.chosen]);
  }

  mirror() {
    if (this.chosen !== null && !this.landmarks.mirror(this.chosen)) say(t("editor.mirror.middle"));
  }

  /** What a point is called for those who hear it. */
  label(number) {
    const [x, y] = this.landmarks.points[number];
    return t("editor.label", {
      n: number,
      part: t(`part.${partOf(number)}`),
      x: x.toFixed(1),
      y: y.toFixed(1),
    });
  }

  draw() {
    const places = this.landmarks.points.map((point) => this.view.outside(point));
    const along = this.chosen === null ? [] : moving(this.chosen, this.reach);
    this.marks.forEach((mark, number) => {
      mark.setAttribute(
        "transform",
        `translate(${places[number].map((value) => value.toFixed(2)).join(" ")})`,
      );
      mark.setAttribute("aria-label", this.label(number));
      mark.classList.toggle("chosen", number === this.chosen);
      mark.classList.toggle("along", along.includes(number));
    });
    LINES.forEach(([first, end, closed], line) => {
      const text = places
        .slice(first, end)
        .map((place) => place.map((value) => value.toFixed(2)).join(" "))
        .join("L");
      this.paths[line].setAttribute("d", `M${text}${closed ? "Z" : ""}`);
    });
    this.back.disabled = !this.landmarks.past.length;
    this.again.disabled = !this.landmarks.future.length;
    this.fold.disabled = this.chosen === null;
    this.spoken.textContent = this.chosen === null ? t("editor.none") : this.label(this.chosen);
  }

  /** The chosen point's surroundings, larger, in the corner that the hand is not in. */
  magnify(event = null) {
    if (this.chosen === null) return;
    const { loupe, view } = this;
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(LOUPE * ratio);
    if (loupe.width !== width) loupe.width = loupe.height = width;
    const [x, y] = this.landmarks.points[this.chosen];
    const scale = Math.max(CLOSER, 2 * view.scale) * ratio;
    const context = loupe.getContext("2d");
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, width, width);
    context.setTransform(scale, 0, 0, scale, width / 2 - scale * (x + 0.5), width / 2 - scale * (y + 0.5));
    context.imageSmoothingEnabled = false;
    context.drawImage(view.picture, 0, 0, ...view.size);
    this.cross(context, width, ratio);
    const place = view.outside([x, y]);
    loupe.classList.toggle("other", place[0] < LOUPE + 40 && place[1] < LOUPE + 40);
    loupe.hidden = false;
    if (event) loupe.dataset.held = "";
  }

  cross(context, width, ratio) {
    context.setTransform(1, 0, 0, 1, 0, 0);
    const middle = width / 2;
    for (const [color, thick] of [
      ["#000", 3],
      ["#fff", 1],
    ]) {
      context.strokeStyle = color;
      context.lineWidth = thick * ratio;
      context.beginPath();
      for (const [dx, dy] of Object.values(ARROWS)) {
        context.moveTo(middle + 5 * ratio * dx, middle + 5 * ratio * dy);
        context.lineTo(middle + 18 * ratio * dx, middle + 18 * ratio * dy);
      }
      context.stroke();
    }
  }
}
