// The pattern wizard: a pattern on the panel, a question about it, a better number; until it is right.

import { get, post } from "./api.js";
import { button, fill, fresh, h, icon, segments } from "./dom.js";
import { said as translated, t } from "./i18n.js";
import { closePanel, showOnPanel, watchPanel } from "./panelwindow.js";
import { action, doing, tool } from "./shell.js";

const STEPS = ["slant", "views", "fringe"];

export class Wizard {
  /** @param {object} display An editable one. `ondone(display)` when it is left. */
  constructor(display, ondone) {
    this.display = display;
    this.ondone = ondone;
    this.step = "slant";
    this.answer = {};
    this.element = h("section.card.stack.wide.wizard", { "aria-label": t("wizard.title") });
    this.end = watchPanel((data) => this.heard(data));
  }

  close() {
    this.end();
  }

  async begin() {
    ({ steps: this.steps } = await get(`/api/displays/${this.display.id}/wizard`));
    this.draw();
  }

  get about() {
    return this.steps.find(({ step }) => step === this.step);
  }

  heard({ fits, window: size, gone }) {
    if (!this.status) return;
    if (gone) this.status.textContent = t("wizard.closed");
    else if (size)
      this.status.textContent = fits
        ? t("wizard.fits")
        : t("wizard.unfit", {
            window: size.join(" x "),
            panel: `${this.display.width} x ${this.display.height}`,
          });
  }

  draw() {
    const { about, display } = this;
    this.answer = {};
    this.status = h("p.small.soft", { role: "status" });
    const numbers = ["pitch", "slant", "offset"].map((name) =>
      h("div", h("dt", h("code", name)), h("dd", Number(display[name]).toFixed(5))),
    );
    fill(
      this.element,
      h(
        "div.row.between",
        h("h2", t("wizard.title")),
        tool("close", t("close"), () => this.leave()),
      ),
      h(
        "ol.wizard-steps.row",
        STEPS.map((name, number) =>
          h("li.tag", {
            "aria-current": name === this.step ? "step" : null,
            class: name === this.step ? "now" : "",
            text: `${number + 1} ${t(`wizard.${name}`)}`,
          }),
        ),
      ),
      h("dl.row.numbers", numbers),
      this.said && h("p.note.good", icon("info"), this.said),
      h("p", t(`wizard.${this.step}.text`)),
      h(
        "div.row",
        action(t("wizard.open"), { drawing: "external", kind: "main" }, () =>
          showOnPanel(about.pattern, display),
        ),
        this.status,
      ),
      h(
        "form.stack.wide",
        {
          onsubmit: (event) => {
            event.preventDefault();
            this.send(event.submitter);
          },
        },
        about.fields.map((field) => this.field(field)),
        h(
          "div.row",
          h("button.button.main", { ".type": "submit", text: t("wizard.next") }),
          button(t("wizard.skip"), () => this.skip(), { kind: "quiet" }),
        ),
      ),
    );
  }

  field({ name, kind, choices }) {
    const text = t(`ask.${this.step}.${name}`);
    const set = (value) => {
      this.answer[name] = value;
    };
    if (kind === "number" || kind === "numbers") {
      const id = fresh("ask");
      return h(
        "div.field",
        h("label", { for: id, text }),
        h("input", {
          id,
          type: kind === "number" ? "number" : "text",
          min: 0,
          step: "any", // half a band counts
          inputmode: kind === "number" ? "decimal" : null, // several need a comma
          class: "short",
          oninput: (event) =>
            set(
              kind === "number"
                ? Number(event.target.value)
                : event.target.value
                    .split(/[\s,;]+/)
                    .filter(Boolean)
                    .map(Number),
            ),
        }),
      );
    }
    const options =
      kind === "yesno"
        ? [
            ["true", t("yes")],
            ["false", t("no")],
          ]
        : choices.map((choice) => [String(choice ?? ""), t(`ask.${this.step}.${name}.${choice ?? "none"}`)]);
    return h(
      "div.field",
      h("span", text),
      segments(text, options, "", (value) => set(kind === "yesno" ? value === "true" : value || null)),
    );
  }

  send(pressed) {
    return doing(async () => {
      const { display, next, said, pattern } = await post(`/api/displays/${this.display.id}/wizard`, {
        step: this.step,
        answer: this.answer,
      }).catch((error) => {
        // The server names the field that it lacks; who sits here looks at questions.
        if (error.code === "bad_request") error.message = t("wizard.answer");
        throw error;
      });
      this.display = display;
      this.said = translated(said);
      if (next === null) return this.finish();
      this.step = next;
      this.about.pattern = pattern;
      this.draw();
      await showOnPanel(pattern, display);
      this.element.querySelector("form input, form button")?.focus();
    })({ currentTarget: pressed });
  }

  skip() {
    const next = STEPS[STEPS.indexOf(this.step) + 1];
    this.said = "";
    if (!next) return this.finish();
    this.step = next;
    this.draw();
  }

  finish() {
    closePanel();
    fill(
      this.element,
      h("h2", t("wizard.done")),
      this.said && h("p", this.said),
      h("p.soft", t("wizard.done.text", { name: this.display.name })),
      h(
        "div.row",
        button(t("wizard.again"), () => {
          this.step = "slant";
          this.said = "";
          this.draw();
        }),
        button(t("close"), () => this.leave(), { kind: "main" }),
      ),
    );
  }

  leave() {
    this.close();
    closePanel();
    this.ondone(this.display);
  }
}
