// Screen 6: which panel, how the head stands in it, what an eye before it sees; and all files.

import { get, picture, post, send } from "../api.js";
import { fill, h, heading, icon, later, segments, slider } from "../dom.js";
import { Exports } from "../exports.js";
import { t } from "../i18n.js";
import { Panels } from "../panels.js";
import { changesOf, drawBudget, PLACE, placementPanel } from "../placement.js";
import { action, fail } from "../shell.js";
import { fineJob, keepJob, keepProject, on } from "../state.js";
import { standingOf } from "../times.js";

export async function showShow(root, sitter, [tab = "panel"]) {
  const screen = new Show(root, sitter, tab);
  await screen.load();
  return () => screen.close();
}

class Show {
  constructor(root, sitter, tab) {
    this.sitter = sitter;
    this.tab = tab === "files" ? "files" : "panel";
    this.place = { ...PLACE, ...sitter.placement };
    this.version = sitter.version;
    this.eyeX = 0;
    this.talk = 1;
    this.list = [];
    this.body = h("div.stack.wide");
    this.quality = h("div.note.fair", { hidden: true });
    this.panels = new Panels(sitter, { onchange: () => this.look(), full: () => this.about() });
    const tabs = segments(
      t("show.parts"),
      [
        ["panel", t("show.panel")],
        ["files", t("show.files")],
      ],
      this.tab,
      (value) => {
        this.tab = value;
        history.replaceState(null, "", `#show/${sitter.id}/${value}`);
        this.draw();
      },
    );
    this.versions = h("select", {
      "aria-label": t("show.version"),
      onchange: () => {
        this.version = this.versions.value;
        this.keep({ version: this.version });
        this.drawQuality();
        this.look();
      },
    });
    fill(
      root,
      heading(t("step.show"), h("p.lead", t("show.lead")), h("div.row", this.versions, tabs)),
      this.quality,
      this.body,
    );
    this.look = later(() => this.see().catch(fail), 200);
    this.store = later(() => this.keep({ placement: changesOf(this.place) }), 800);
    this.ends = [
      on("versions", ({ project: which }) => which === sitter.id && this.renew().catch(fail)),
      on("job", (job) => job.project === sitter.id && job.kind === "fine" && this.drawQuality()),
      on("progress", ({ job }) => job === this.making && this.drawQuality()),
    ];
  }

  close() {
    for (const end of this.ends) end();
    this.look.stop();
    this.stopper?.abort();
    this.panels.close();
    this.files?.close();
  }

  keep(what) {
    send("PATCH", `/api/projects/${this.sitter.id}`, what).then(keepProject).catch(fail);
  }

  async load() {
    await Promise.all([this.panels.load(), this.readVersions()]);
    this.draw();
  }

  /** The versions again; one that is fine by now looks different. */
  async renew() {
    const before = this.shown;
    await this.readVersions();
    this.files?.drawMade(); // versions may have other names
    if (this.shown?.id !== before?.id || this.shown?.fine !== before?.fine) this.look();
  }

  get shown() {
    return this.list.find(({ id }) => id === this.version) ?? null;
  }

  /** Whether all here is a preview, and what can be done about it. */
  drawQuality() {
    const { shown, sitter } = this;
    const job = shown && fineJob(sitter.id, shown.id);
    this.making = job?.id;
    this.quality.hidden = !shown || shown.fine;
    if (this.quality.hidden) return;
    fill(
      this.quality,
      icon("fair"),
      h(
        "div.row.between",
        h("p", t("show.draft", { name: shown.name })),
        job
          ? h("a.button", { href: `#making/${sitter.id}` }, t("portrait.making", { how: standingOf(job) }))
          : !shown.from_command_line &&
              action(t("portrait.fine"), { drawing: "spark" }, async () => {
                keepJob(await post(`/api/projects/${sitter.id}/versions/${shown.id}/fine`));
              }),
      ),
    );
  }

  async readVersions() {
    const { versions } = await get(`/api/projects/${this.sitter.id}/versions`);
    this.list = versions;
    if (!versions.some(({ id }) => id === this.version)) this.version = versions.at(-1)?.id ?? null;
    fill(
      this.versions,
      versions.map(({ id, name, fine }) =>
        h("option", {
          value: id,
          text: fine ? name : `${name} (${t("version.draft")})`,
          selected: id === this.version,
        }),
      ),
    );
    this.versions.hidden = versions.length === 0;
    this.drawQuality();
  }

  /** What is shown, and how. */
  about() {
    return { version: this.version, display: this.panels.display.id, placement: changesOf(this.place) };
  }

  draw() {
    this.files?.close();
    this.files = null;
    if (!this.version) {
      fill(
        this.body,
        h(
          "div.empty",
          icon("show"),
          h("h2", t("show.none")),
          h("p", t("show.none.text")),
          h("a.button.main", { href: `#style/${this.sitter.id}`, text: t("step.style") }),
        ),
      );
    } else if (this.tab === "files") {
      this.files = new Exports(
        this.sitter,
        () => this.about(),
        () => this.panels.display,
        () => this.shown,
        (id) => this.list.find((each) => each.id === id)?.name ?? "",
      );
      fill(this.body, this.files.element);
      this.files.load().catch(fail);
    } else {
      this.drawPanel();
    }
  }

  drawPanel() {
    this.eye = h("canvas", { role: "img", "aria-label": t("eye.alt") });
    this.budget = h("div.stack");
    this.note = h("p.small.soft", { role: "status" });
    const eyeAt = slider(t("eye.place"), {
      min: -1,
      max: 1,
      step: 0.02,
      value: this.eyeX,
      note: t("eye.text"),
      oninput: (value) => {
        this.eyeX = value;
        this.look();
      },
    });
    const crosstalk = slider("crosstalk", {
      min: 0,
      max: 3,
      step: 0.1,
      value: this.talk,
      digits: 1,
      note: t("eye.crosstalk"),
      oninput: (value) => {
        this.talk = value;
        this.look();
      },
    });
    const placement = placementPanel(
      this.place,
      () => {
        this.look();
        this.store();
      },
      () => {
        this.place = { ...PLACE };
        this.drawPanel();
        this.store();
      },
    );
    fill(
      this.body,
      this.panels.wizardPlace,
      h(
        "div.show-body",
        h(
          "div.stack",
          h("figure.eye.first", this.eye, this.note),
          h("div.eye-sliders", eyeAt, crosstalk),
          this.budget,
        ),
        h("aside.side.stack.wide", { "aria-label": t("show.settings") }, this.panels.element, placement),
      ),
    );
    this.look();
  }

  /** What an eye sees, and the depth that the panel has for it. */
  async see() {
    if (!this.version || this.tab !== "panel") return;
    this.stopper?.abort();
    const stopper = new AbortController();
    this.stopper = stopper;
    const about = this.about(),
      path = `/api/projects/${this.sitter.id}`;
    this.note.textContent = t("eye.wait");
    post(`${path}/budget`, about, stopper.signal)
      .then((found) => drawBudget(this.budget, found))
      .catch((error) => error.code === "busy" || fail(error));
    try {
      const { image } = await picture(
        `${path}/eye`,
        { ...about, eye: [this.eyeX, 0], crosstalk: this.talk, width: 960, slot: "eye" },
        stopper.signal,
      );
      Object.assign(this.eye, { width: image.width, height: image.height });
      this.eye.getContext("2d").drawImage(image, 0, 0);
      this.eye.parentElement.classList.remove("first");
      this.note.textContent = "";
    } catch (error) {
      if (error.name === "AbortError" || error.code === "busy") return;
      this.note.textContent = error.message;
    }
  }
}
