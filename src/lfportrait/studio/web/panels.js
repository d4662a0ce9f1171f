// Which panel: presets, files, those that Bridge knows; its wizard, and its own window.

import { get, post, send } from "./api.js";
import { ask, fill, h, icon } from "./dom.js";
import { chooser } from "./drop.js";
import { said, t } from "./i18n.js";
import { showOnPanel } from "./panelwindow.js";
import { action, doing, fail, say, tool } from "./shell.js";
import { keepProject } from "./state.js";
import { Wizard } from "./wizard.js";

export class Panels {
  /**
   * @param {object} sitter
   * @param {object} how `onchange()` when another panel is chosen or its numbers change, `full()`
   *   gives what the panel's window is to show.
   */
  constructor(sitter, { onchange, full }) {
    Object.assign(this, { sitter, onchange, full, displays: [], chosen: sitter.display });
    this.element = h("section.card.stack", { "aria-label": t("show.panel") });
    this.wizardPlace = h("div.wizard-place");
  }

  close() {
    this.wizard?.close();
  }

  async load() {
    ({ displays: this.displays } = await get(`/api/displays?project=${this.sitter.id}`));
    if (!this.displays.some(({ id }) => id === this.chosen)) {
      this.chosen = (this.displays.find(({ id }) => id === "generic-4k") ?? this.displays[0]).id;
    }
    this.draw();
  }

  get display() {
    return this.displays.find(({ id }) => id === this.chosen);
  }

  draw() {
    const { display } = this;
    const groups = ["file", "bridge", "preset"].map((kind) => {
      const some = this.displays.filter((each) => each.kind === kind);
      return (
        some.length > 0 &&
        h(
          "optgroup",
          { label: t(`display.${kind}`) },
          some.map((each) =>
            h("option", { value: each.id, text: each.name, selected: each.id === display.id }),
          ),
        )
      );
    });
    const choice = h("select", { id: "display", onchange: doing(() => this.choose(choice.value)) }, groups);
    const file = { accept: ".json,.toml,application/json", id: "display-file" };
    const read = async ([one]) => {
      if (one) await this.add({ name: one.name.replace(/\.[^.]*$/, ""), text: await one.text() });
    };
    fill(
      this.element,
      h("label.field", { for: "display" }, h("span", t("display.choose")), choice),
      h("p.small.soft", said(display.summary)),
      !display.calibrated && h("p.note.fair.small", icon("fair"), t("display.uncalibrated")),
      h(
        "div.row",
        chooser(t("display.file"), { drawing: "folder" }, file, (files) => read(files).catch(fail)),
        action(t("display.bridge.ask"), { drawing: "link" }, () => this.ask()),
      ),
      h(
        "div.row",
        action(t("wizard.start"), { drawing: "eye", "data-act": "wizard" }, () => this.openWizard()),
        action(t("panel.show"), { drawing: "external" }, () => this.show()),
      ),
      display.editable &&
        h(
          "div.row",
          h(
            "a.button.quiet",
            { href: `/api/displays/${display.id}/file`, download: "" },
            icon("download"),
            t("display.save"),
          ),
          tool("trash", t("display.remove", { name: display.name }), () => this.remove()),
        ),
    );
  }

  async choose(id) {
    this.chosen = id;
    this.draw();
    this.element.querySelector("select").focus();
    this.onchange();
    keepProject(await send("PATCH", `/api/projects/${this.sitter.id}`, { display: id }));
  }

  async add(body) {
    const made = await post("/api/displays", body);
    this.displays = [...this.displays.filter(({ id }) => id !== made.id), made];
    await this.choose(made.id);
    say(t("display.added", { name: made.name }));
  }

  /** The panels that Bridge knows, to be kept as files. */
  async ask() {
    const { running, displays, message } = await get("/api/displays/bridge");
    if (!running || !displays.length) return say(message || t("display.bridge.none"), { wrong: true });
    const answer =
      displays.length === 1
        ? "0"
        : await ask(
            t("display.bridge.which"),
            h("p.soft", t("display.bridge.text")),
            displays.map(({ name }, index) => [String(index), name]),
          );
    if (answer !== "") await this.add({ name: displays[Number(answer)].name, bridge: Number(answer) });
  }

  async remove() {
    const { display } = this;
    const answer = await ask(t("display.remove", { name: display.name }), h("p", t("display.remove.text")), [
      ["yes", t("remove"), "danger"],
    ]);
    if (!answer) return;
    await send("DELETE", `/api/displays/${display.id}`);
    this.displays = this.displays.filter(({ id }) => id !== display.id);
    await this.choose(this.displays.find(({ id }) => id === "generic-4k")?.id ?? this.displays[0].id);
  }

  /** The coded portrait in the panel's own window. */
  async show() {
    say(t("panel.coding"));
    const { picture } = await post(`/api/projects/${this.sitter.id}/full`, this.full());
    await showOnPanel(picture, this.display);
  }

  /** The wizard changes numbers: of a preset it takes a copy. */
  async openWizard() {
    const { display } = this;
    if (!display.editable)
      await this.add({ name: t("display.copy", { name: display.name }), copy: display.id });
    this.wizard?.close();
    this.wizard = new Wizard(this.display, (changed) => {
      this.displays = this.displays.map((each) => (each.id === changed.id ? changed : each));
      fill(this.wizardPlace);
      this.wizard = null;
      this.draw();
      this.element.querySelector("[data-act=wizard]").focus();
      this.onchange();
    });
    await this.wizard.begin();
    fill(this.wizardPlace, this.wizard.element);
    this.wizard.element.scrollIntoView({ block: "nearest" });
    this.wizard.element.querySelector("button.main")?.focus({ preventScroll: true });
  }
}
