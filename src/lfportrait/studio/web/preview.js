// The picture of this sitter that follows what is changed: the last wish counts, the older is dropped.

import { picture } from "./api.js";
import { fill, h, icon, later } from "./dom.js";
import { t } from "./i18n.js";
import { fail } from "./shell.js";
import { on } from "./state.js";

export class Preview {
  /**
   * @param {object} sitter
   * @param {function} wish Gives the body of the request.
   * @param {number} wait Milliseconds after the last change.
   */
  constructor(sitter, wish, wait = 180) {
    this.sitter = sitter;
    this.wish = wish;
    this.canvas = h("canvas", {
      role: "img",
      "aria-label": t("preview.alt", { sitter: sitter.name, name: "" }),
    });
    this.note = h("p.soft.small", { "aria-live": "polite" });
    this.element = h("figure.preview", this.canvas, this.note);
    this.ask = later(() => this.draw(), wait);
    if (sitter.has.field) return;
    this.element.classList.add("none");
    fill(this.element, h("p.note.fair", icon("fair"), t("editor.nohead")));
    this.end = on("project", (item) => item.id === sitter.id && item.has.field && this.begin(item));
  }

  /** The head is made: from now on there is a preview. */
  begin(sitter) {
    this.end();
    this.sitter = sitter;
    this.element.classList.remove("none");
    fill(this.element, this.canvas, this.note);
    this.draw();
  }

  close() {
    this.end?.();
    this.ask.stop();
    this.stopper?.abort();
  }

  async draw() {
    if (!this.sitter.has.field) return;
    this.stopper?.abort();
    const stopper = new AbortController();
    this.stopper = stopper;
    this.element.classList.add("wait");
    try {
      const start = performance.now();
      const { image } = await picture(`/api/projects/${this.sitter.id}/preview`, this.wish(), stopper.signal);
      if (stopper.signal.aborted) return;
      this.canvas.width = image.width;
      this.canvas.height = image.height;
      this.canvas.getContext("2d").drawImage(image, 0, 0);
      const took = (performance.now() - start) / 1000;
      this.element.dataset.seconds = took.toFixed(2);
      this.note.textContent = t("preview.took", { n: took.toFixed(1) });
    } catch (error) {
      if (error.name === "AbortError" || error.code === "busy") return;
      this.note.textContent = error.message;
      if (error.code !== "user_error") fail(error);
    } finally {
      if (this.stopper === stopper) this.element.classList.remove("wait");
    }
  }
}
