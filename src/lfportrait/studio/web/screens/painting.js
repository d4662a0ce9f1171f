// Regions of a painting, painted over by a brush where the detector is wrong.

import { bitmap, get, put, send } from "../api.js";
import { ask, fill, h, later, sign, slider } from "../dom.js";
import { t } from "../i18n.js";
import { Preview } from "../preview.js";
import { COLORS, labelsOf, Regions } from "../regions.js";
import { doing, fail } from "../shell.js";
import { Viewport } from "../viewport.js";
import { editorHead, styleOf, toGallery, whileRead } from "./landmarking.js";

const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export async function showRegions(root, sitter, id) {
  root.classList.add("full");
  const style = await styleOf(sitter, id);
  if (!style) return toGallery(sitter);
  const path = `/api/styles/${id}/regions?project=${sitter.id}`;
  const saved = h("p.soft", { role: "status" });
  const head = editorHead(sitter, style, "regions.title", saved);
  whileRead(root, head, style);
  const about = await get(path);
  const size = [about.width, about.height];
  const [image, found, painted] = await Promise.all([
    bitmap(style.full),
    bitmap(about.found),
    about.picture ? bitmap(about.picture) : null,
  ]);
  const regions = new Regions(size, labelsOf(found, size), painted && labelsOf(painted, size));
  saved.textContent = t(about.painted ? "editor.edited" : "editor.found");
  const preview = new Preview(sitter, () => ({ style: id, draft: true, slot: "editor", size: 480 }), 0);
  const brush = new Brush(
    image,
    regions,
    about.labels,
    doing(async () => {
      const answer = await ask(t("regions.reset"), h("p", t("regions.reset.text")), [
        ["yes", t("regions.reset"), "danger"],
      ]);
      if (!answer) return;
      regions.clear();
      save.stop();
      open = false;
      await send("DELETE", path);
      preview.ask();
    }),
  );
  let open = false;
  const write = async () => {
    open = false;
    saved.textContent = t("editor.saving");
    await put(path, await regions.file());
    saved.textContent = t("editor.saved");
    // The preview reads what is saved.
    preview.ask();
  };
  const save = later(() => write().catch(fail), 400);
  regions.watch(() => {
    open = true;
    saved.textContent = t("editor.open");
    save();
  });
  fill(root, head, h("div.editing", brush.element, preview.element));
  preview.draw();
  return async () => {
    save.stop();
    preview.close();
    brush.close();
    if (open) await write().catch(fail);
  };
}

class Brush {
  constructor(image, regions, labels, onreset) {
    this.regions = regions;
    this.label = 1;
    this.radius = Math.max(...regions.size) / 40;
    this.at = regions.size.map((value) => value / 2);
    this.view = new Viewport(image, regions.size);
    this.view.taken = (event) => event.button === 0 && !event.target.closest("button");
    this.view.layers.push((context) => {
      context.imageSmoothingEnabled = false;
      context.drawImage(regions.canvas, 0, 0);
    });
    // The brush is a thing of its own, so that keys can hold it.
    this.ring = h(
      "svg:g.brush",
      { tabindex: 0, role: "button", onkeydown: (event) => this.key(event) },
      h("svg:circle.halo"),
      h("svg:circle.dot"),
    );
    this.view.element.append(h("svg:svg.points", this.ring), this.view.buttons());
    this.view.element.addEventListener("pointerdown", (event) => this.down(event));
    this.view.element.addEventListener("pointermove", (event) => this.follow(event));
    this.view.element.addEventListener("pinch", () => this.release());
    this.view.watch(() => this.place());
    regions.watch(() => this.buttons());
    this.element = h(
      "div.editor",
      this.tools(labels, onreset),
      this.view.element,
      h("p.small.soft.hint", t("regions.hint")),
    );
    this.element.addEventListener("keydown", (event) => this.shortcut(event));
    this.buttons();
  }

  close() {
    this.view.close();
  }

  release() {}

  tools(labels, onreset) {
    this.kinds = labels.map((name, label) => {
      const one = h(
        "button.kind",
        { "aria-pressed": String(label === this.label), onclick: () => this.choose(label) },
        h("span.swatch", { class: label ? "" : "none" }),
        t(`region.${name}`),
      );
      if (COLORS[label]) one.firstChild.style.background = `rgb(${COLORS[label].join(" ")})`;
      return one;
    });
    this.back = sign("undo", t("editor.undo"), () => this.after(this.regions.undo()));
    this.again = sign("redo", t("editor.redo"), () => this.after(this.regions.redo()));
    this.width = slider(t("regions.size"), {
      min: 1,
      max: Math.round(Math.max(...this.regions.size) / 6),
      step: 1,
      value: Math.round(this.radius),
      digits: 0,
      oninput: (value) => {
        this.radius = value;
        this.place();
      },
    });
    return h(
      "div.tools",
      { role: "toolbar", "aria-label": t("editor.tools") },
      h("div.kinds", { role: "group", "aria-label": t("regions.kind") }, this.kinds),
      this.width,
      this.back,
      this.again,
      sign("reset", t("regions.reset"), onreset),
    );
  }

  choose(label) {
    this.label = label;
    this.kinds.forEach((each, index) => {
      each.setAttribute("aria-pressed", String(index === label));
    });
    this.place();
  }

  buttons() {
    this.back.disabled = !this.regions.past.length;
    this.again.disabled = !this.regions.future.length;
    this.view.draw();
  }

  after() {
    this.view.draw();
  }

  place() {
    const [x, y] = this.view.outside(this.at);
    this.ring.setAttribute("transform", `translate(${x.toFixed(1)} ${y.toFixed(1)})`);
    for (const circle of this.ring.children)
      circle.setAttribute("r", (this.radius * this.view.scale).toFixed(1));
    this.ring.setAttribute(
      "aria-label",
      t("regions.brush", {
        kind: this.kinds[this.label].textContent,
        x: this.at[0].toFixed(0),
        y: this.at[1].toFixed(0),
        size: this.radius.toFixed(0),
      }),
    );
  }

  follow(event) {
    this.at = this.view.inside(event);
    this.place();
  }

  down(event) {
    if (this.view.held || event.button !== 0 || event.target.closest("button")) return;
    event.preventDefault();
    this.ring.focus({ preventScroll: true });
    let last = this.view.inside(event);
    this.at = last;
    this.regions.begin();
    this.regions.line(last, last, this.radius, this.label);
    this.view.draw();
    const { element } = this.view;
    element.setPointerCapture(event.pointerId);
    const draw = (next) => {
      // All places between two frames: a quick stroke stays round.
      for (const each of next.getCoalescedEvents?.() ?? [next]) {
        const now = this.view.inside(each);
        this.regions.line(last, now, this.radius, this.label);
        last = now;
      }
      this.view.draw();
    };
    this.release = () => {
      element.removeEventListener("pointermove", draw);
      for (const name of ["pointerup", "pointercancel"]) element.removeEventListener(name, this.release);
      this.release = () => {};
      this.regions.end();
    };
    element.addEventListener("pointermove", draw);
    for (const name of ["pointerup", "pointercancel"]) element.addEventListener(name, this.release);
  }

  /** Arrows move the brush, Space paints where it is. */
  key(event) {
    if (event.key === " ") {
      event.preventDefault();
      this.regions.begin();
      this.regions.line(this.at, this.at, this.radius, this.label);
      this.regions.end();
      return this.view.draw();
    }
    const step = STEPS[event.key];
    if (!step || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const by = event.shiftKey ? 10 : Math.max(1, this.radius / 2);
    const next = this.at.map((value, k) =>
      Math.min(Math.max(value + by * step[k], 0), this.regions.size[k] - 1),
    );
    this.at = next;
    this.view.reveal(next);
    this.place();
  }

  shortcut(event) {
    const key = event.key.toLowerCase(),
      control = event.ctrlKey || event.metaKey;
    if (control && (key === "z" || key === "y")) {
      event.preventDefault();
      this.after(key === "y" || event.shiftKey ? this.regions.redo() : this.regions.undo());
    } else if (!control && !event.altKey && event.target.tagName !== "INPUT") {
      if (/^[0-9]$/.test(key) && this.kinds[Number(key)]) this.choose(Number(key));
      else if (key === "[" || key === "]") {
        this.radius = Math.max(1, this.radius * (key === "]" ? 1.2 : 1 / 1.2));
        this.width.show(this.radius);
        this.place();
      } else if (key === "+" || key === "=") this.view.zoom(1.4, this.view.outside(this.at));
      else if (key === "-") this.view.zoom(1 / 1.4, this.view.outside(this.at));
    }
  }
}
