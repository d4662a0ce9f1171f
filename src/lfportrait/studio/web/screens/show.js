// Screen 6: which panel, how the head stands in it, what an eye before it sees; and all files.

import { get, picture, post, send } from "../api.js";
import { ask, button, fill, h, icon, later, segments, slider } from "../dom.js";
import { Exports } from "../exports.js";
import { t } from "../i18n.js";
import { showOnPanel } from "../panelwindow.js";
import { doing, fail, say } from "../shell.js";
import { keepProject, on } from "../state.js";
import { Wizard } from "../wizard.js";

const PLACE = { size: 0.8, shift_x: 0, shift_y: -0.04, focus: 0, depth_scale: 1, turn: 0, compose: true, ground: "painted", ground_depth: 0.45, blend: "nearest" };
const SLIDERS = [["size", 0.3, 1.6, 0.01], ["focus", -1, 1, 0.01], ["depth_scale", 0.2, 1.5, 0.01], ["shift_y", -0.6, 0.6, 0.01], ["turn", -40, 40, 1], ["ground_depth", 0, 1.5, 0.01]];

export async function showShow(root, sitter, [tab = "panel"]) {
  const screen = new Show(root, sitter, tab);
  await screen.load();
  return () => screen.close();
}

class Show {
  constructor(root, sitter, tab) {
    this.sitter = sitter;
    this.tab = tab === "files" ? "files" : "panel";
    this.place = { ...PLACE, ...sitter.options?.placement };
    this.version = sitter.version;
    this.body = h("div.stack.wide");
    this.tabs = segments(t("show.parts"), [["panel", t("show.panel")], ["files", t("show.files")]], this.tab, (value) => {
      this.tab = value;
      history.replaceState(null, "", `#show/${sitter.id}/${value}`);
      this.draw();
    });
    this.versions = h("select", { "aria-label": t("show.version"), onchange: () => {
      this.version = this.versions.value;
      send("PATCH", `/api/projects/${sitter.id}`, { version: this.version }).then(keepProject).catch(fail);
      this.look();
      this.files?.setVersion(this.version);
    } });
    fill(root, h("header", {}, h("div", {}, h("h1", { text: t("step.show") }), h("p.lead", { text: t("show.lead") })), h("div.row", {}, this.versions, this.tabs)), this.body);
    this.look = later(() => this.see().catch(fail), 250);
    this.store = later(() => send("PATCH", `/api/projects/${sitter.id}`, { options: { placement: this.changes() } }).then(keepProject).catch(fail), 800);
    this.ends = [on("versions", ({ project: which }) => which === sitter.id && this.readVersions().catch(fail))];
  }

  close() {
    for (const end of this.ends) end();
    this.look.stop();
    this.stopper?.abort();
    this.wizard?.close();
    this.files?.close();
  }

  /** The placement without what is as `make` has it. */
  changes() {
    return Object.fromEntries(Object.entries(this.place).filter(([name, value]) => value !== PLACE[name]));
  }

  async load() {
    const [{ displays, bridge }] = await Promise.all([get(`/api/displays?project=${this.sitter.id}`), this.readVersions()]);
    Object.assign(this, { displays, bridge });
    if (!displays.some(({ id }) => id === this.sitter.display)) this.sitter = { ...this.sitter, display: displays.find(({ id }) => id === "generic-4k")?.id ?? displays[0]?.id };
    this.draw();
  }

  async readVersions() {
    const { versions } = await get(`/api/projects/${this.sitter.id}/versions`);
    this.all = versions;
    if (!versions.some(({ id }) => id === this.version)) this.version = versions.at(-1)?.id ?? null;
    fill(this.versions, versions.map(({ id, name, fine }) => h("option", { value: id, text: fine ? name : `${name} (${t("version.draft")})`, selected: id === this.version })));
    this.versions.hidden = versions.length === 0;
  }

  get display() {
    return this.displays.find(({ id }) => id === this.sitter.display) ?? this.displays[0];
  }

  draw() {
    this.files?.close();
    this.files = null;
    if (!this.version) {
      fill(this.body, h("div.empty", {}, icon("show"), h("h2", { text: t("show.none") }), h("p", { text: t("show.none.text") }), h("a.button.main", { href: `#style/${this.sitter.id}`, text: t("step.style") })));
      return;
    }
    if (this.tab === "files") {
      this.files = new Exports(this.sitter, () => ({ version: this.version, display: this.display.id, placement: this.changes() }), () => this.display);
      fill(this.body, this.files.element);
      this.files.load().catch(fail);
      return;
    }
    this.drawPanel();
  }

  drawPanel() {
    this.eye = h("canvas", { role: "img", "aria-label": t("eye.alt") });
    this.eyeAt = slider(t("eye.place"), { min: -1, max: 1, step: 0.02, value: this.eyeX ?? 0, note: t("eye.text"), oninput: (value) => { this.eyeX = value; this.look(); } });
    this.crosstalk = slider("crosstalk", { min: 0, max: 3, step: 0.1, value: this.talk ?? 1, digits: 1, note: t("eye.crosstalk"), oninput: (value) => { this.talk = value; this.look(); } });
    this.budget = h("div.stack");
    this.note = h("p.small.soft", { role: "status" });
    this.panelCard = h("section.card.stack", { "aria-label": t("show.panel") });
    this.wizardPlace = h("div");
    fill(this.body, this.wizardPlace, h("div.show-body", {}, h("div.stack", {}, h("figure.eye", {}, this.eye, this.note), h("div.eye-sliders", {}, this.eyeAt, this.crosstalk), this.budget),
      h("aside.side.stack.wide", { "aria-label": t("show.settings") }, this.panelCard, this.placement())));
    this.drawDisplay();
    this.look();
  }

  drawDisplay() {
    const { display } = this;
    const choice = h("select", { id: "display", onchange: () => this.choose(choice.value) }, ["file", "bridge", "preset"].map((kind) => {
      const some = this.displays.filter((each) => each.kind === kind);
      return some.length > 0 && h("optgroup", { label: t(`display.${kind}`) }, some.map((each) => h("option", { value: each.id, text: each.name, selected: each.id === display.id })));
    }));
    const file = h("input", { type: "file", hidden: true, accept: ".json,.toml,application/json", id: "display-file", onchange: doing(async () => {
      const [one] = file.files;
      file.value = "";
      if (one) await this.add({ name: one.name.replace(/\.[^.]*$/, ""), text: await one.text() });
    }) });
    fill(this.panelCard, h("label.field", { for: "display" }, h("span", { text: t("display.choose") }), choice),
      h("p.small.soft", { text: display.summary }),
      !display.calibrated && h("p.note.fair.small", {}, icon("fair"), t("display.uncalibrated")),
      h("div.row", {}, button(t("display.file"), () => file.click(), { drawing: "folder" }), button(t("display.bridge.ask"), doing(() => this.ask()), { drawing: "link" }), file),
      h("div.row", {}, button(t("wizard.start"), doing(() => this.openWizard()), { drawing: "eye" }),
        button(t("panel.show"), doing(async () => {
          say(t("panel.coding"));
          const { picture: path } = await post(`/api/projects/${this.sitter.id}/full`, { version: this.version, display: display.id, placement: this.changes() });
          await showOnPanel(path, display);
        }), { drawing: "external" }),
        display.editable && h("a.button.quiet", { href: `/api/displays/${display.id}/file`, download: "" }, icon("download"), t("display.save")),
        display.editable && button("", doing(() => this.remove()), { kind: "quiet tool", drawing: "trash", name: t("display.remove", { name: display.name }) })));
  }

  async choose(id) {
    this.sitter = { ...this.sitter, display: id };
    this.drawDisplay();
    document.getElementById("display")?.focus();
    this.look();
    keepProject(await send("PATCH", `/api/projects/${this.sitter.id}`, { display: id }));
  }

  async add(body) {
    const made = await post("/api/displays", body);
    this.displays.push(made);
    await this.choose(made.id);
    say(t("display.added", { name: made.name }));
  }

  /** The panels that Bridge knows, to be kept as files. */
  async ask() {
    const { running, displays, message } = await get("/api/displays/bridge");
    if (!running || !displays.length) return say(message || t("display.bridge.none"), { wrong: true });
    const answer = displays.length === 1 ? "0" : await ask(t("display.bridge.which"), h("p.soft", { text: t("display.bridge.text") }), [["", t("cancel")], ...displays.map(({ name }, index) => [String(index), name])]);
    if (answer !== "") await this.add({ name: displays[Number(answer)].name, bridge: Number(answer) });
  }

  async remove() {
    const { display } = this;
    const answer = await ask(t("display.remove", { name: display.name }), h("p", { text: t("display.remove.text") }), [["", t("cancel")], ["yes", t("remove"), "danger"]]);
    if (!answer) return;
    await send("DELETE", `/api/displays/${display.id}`);
    this.displays = this.displays.filter(({ id }) => id !== display.id);
    await this.choose(this.displays[0].id);
  }

  /** The wizard changes numbers: of a preset it makes a copy first. */
  async openWizard() {
    const { display } = this;
    if (!display.editable) await this.add({ name: t("display.copy", { name: display.name }), copy: display.id });
    this.wizard?.close();
    this.wizard = new Wizard(this.display, (changed) => {
      this.displays = this.displays.map((each) => each.id === changed.id ? changed : each);
      fill(this.wizardPlace);
      this.wizard = null;
      this.drawDisplay();
      this.look();
    });
    fill(this.wizardPlace, this.wizard.element);
    await this.wizard.begin();
    this.wizard.element.querySelector("button")?.focus();
    this.wizard.element.scrollIntoView({ block: "nearest" });
  }

  placement() {
    const changed = () => {
      this.look();
      this.store();
    };
    const sliders = SLIDERS.map(([name, min, max, step]) => slider(name, { min, max, step, value: this.place[name], digits: step < 1 ? 2 : 0, note: t(`place.${name}`), oninput: (value) => {
      this.place[name] = value;
      changed();
    } }));
    const compose = h("input", { type: "checkbox", id: "compose", ".checked": this.place.compose, onchange: () => {
      this.place.compose = compose.checked;
      changed();
    } });
    const choice = (name, values) => h("div.field", {}, h("span", {}, h("code", { text: name })), segments(name, values.map((value) => [value, t(`${name}.${value}`)]), this.place[name], (value) => {
      this.place[name] = value;
      changed();
    }));
    return h("section.stack", { "aria-label": t("place.title") }, h("div.row.between", {}, h("h2", { text: t("place.title") }), button(t("place.reset"), () => {
      this.place = { ...PLACE };
      this.drawPanel();
      this.store();
    }, { kind: "quiet" })),
    h("label.check", { for: "compose" }, compose, h("span", {}, h("code", { text: "compose" }), " ", h("span.soft.small", { text: t("place.compose") }))),
    sliders, choice("ground", ["painted", "black", "white"]), choice("blend", ["nearest", "continuous", "filtered"]));
  }

  /** What an eye sees, and the depth that the panel has for it. */
  async see() {
    if (!this.version || this.tab !== "panel") return;
    this.stopper?.abort();
    const { signal } = this.stopper = new AbortController();
    const about = { display: this.display.id, version: this.version, placement: this.changes() };
    const path = `/api/projects/${this.sitter.id}`;
    this.note.textContent = t("eye.wait");
    post(`${path}/budget`, about, signal).then((found) => this.drawBudget(found)).catch((error) => error.code === "busy" || fail(error));
    try {
      const { image } = await picture(`${path}/eye`, { ...about, eye: [this.eyeX ?? 0, 0], crosstalk: this.talk ?? 1, width: 960, slot: "eye" }, signal);
      Object.assign(this.eye, { width: image.width, height: image.height });
      this.eye.getContext("2d").drawImage(image, 0, 0);
      this.note.textContent = "";
    } catch (error) {
      if (error.name === "AbortError" || error.code === "busy") return;
      this.note.textContent = error.message;
    }
  }

  /** A bar of depth: what is sharp, and where the head lies in it. */
  drawBudget({ lines, sharp, head }) {
    const least = Math.min(sharp[0], head[0]) - 0.1, most = Math.max(sharp[1], head[1]) + 0.1;
    const x = (value) => 400 * (value - least) / (most - least);
    fill(this.budget, h("figure.budget", {}, h("svg:svg", { viewBox: "0 0 400 64", role: "img", "aria-label": t("budget.alt", { back: head[0].toFixed(2), front: head[1].toFixed(2), from: sharp[0].toFixed(2), to: sharp[1].toFixed(2) }) },
      h("svg:rect.sharp", { x: x(sharp[0]), y: 10, width: x(sharp[1]) - x(sharp[0]), height: 34, rx: 4 }),
      h("svg:rect.head", { x: x(head[0]), y: 19, width: x(head[1]) - x(head[0]), height: 16, rx: 8 }),
      h("svg:path.plane", { d: `M${x(0)} 4V50` }),
      h("svg:text", { x: x(0), y: 62, class: "middle", text: t("budget.plane") }), h("svg:text", { x: 0, y: 62, text: t("budget.back") }), h("svg:text.end", { x: 400, y: 62, text: t("budget.front") }))),
    h("ul.small.soft", {}, lines.map((text) => h("li", { text }))));
  }
}

