// Screen 5: the portrait, what of it is photo and what painting, named versions, two side by side.

import { get, post, send } from "../api.js";
import { Beside } from "../beside.js";
import { ask, fill, h, heading, icon, later } from "../dom.js";
import { nameOf } from "../naming.js";
import { t } from "../i18n.js";
import { MixPanel, plainMix, STEADY } from "../mix.js";
import { action, fail, say, tool } from "../shell.js";
import { Stage } from "../stage.js";
import { fineJob, keepJob, keepProject, on } from "../state.js";
import { standingOf } from "../times.js";

export async function showPortrait(root, sitter, [version, other]) {
  root.classList.add("full");
  const screen = new Portrait(root, sitter, version, other);
  await screen.load();
  return () => screen.close();
}

/** What a newer wish has taken the place of is no error. */
function ignore(error) {
  if (error.code !== "busy") fail(error);
}

export class Portrait {
  constructor(root, sitter, version, other) {
    this.sitter = sitter;
    this.chosen = version || sitter.version;
    this.second = other || null;
    this.versions = [];
    this.stages = h("div.stages-pair");
    this.list = h("ul.versions", { "aria-label": t("portrait.versions") });
    this.actions = h("div.row");
    this.panel = new MixPanel({
      onbegin: (ends, name, share) => this.begin(ends, name, share),
      onmove: (mix, share, name) => this.move(mix, share, name),
      onend: (mix) => this.end(mix),
    });
    this.compare = action(
      t("portrait.compare"),
      {
        drawing: "compare",
        "aria-pressed": "false",
      },
      () => this.toggleCompare(),
    );
    const next = h("a.button.main", { href: `#show/${sitter.id}` }, t("step.show"), icon("right"));
    this.ways = h("div.row", this.compare, next);
    fill(
      root,
      heading(t("step.portrait"), h("p.lead", t("portrait.lead")), this.ways),
      h(
        "div.portrait-body",
        this.stages,
        h(
          "aside.side.stack.wide",
          { "aria-label": t("portrait.settings") },
          this.list,
          this.actions,
          this.panel.element,
        ),
      ),
    );
    this.save = later(() => this.store().catch(fail), 350);
    this.ends = [
      on("versions", ({ project: which }) => which === sitter.id && this.reload().catch(fail)),
      on("job", (job) => job.project === sitter.id && this.drawActions()),
      on("progress", ({ job }) => job === this.making?.id && this.drawHow()),
    ];
  }

  async close() {
    for (const end of this.ends) end();
    this.stage?.close();
    this.beside?.close();
    this.save.stop();
    if (this.open) await this.store().catch(fail);
  }

  get version() {
    return this.versions.find(({ id }) => id === this.chosen) ?? null;
  }

  async load() {
    await this.reload();
    if (!this.versions.length && !this.sitter.has.field) {
      this.ways.hidden = this.actions.hidden = true; // there is nothing to compare, show or paint yet
      fill(
        this.stages,
        h(
          "div.empty",
          icon("portrait"),
          h("h2", t("portrait.none")),
          h("p", t("portrait.none.text")),
          h("a.button.main", { href: `#making/${this.sitter.id}`, text: t("step.making") }),
        ),
      );
      return;
    }
    this.stage = new Stage(this.sitter, t("portrait.alt", { name: this.sitter.name }));
    this.title = h("strong.some");
    fill(this.stages, h("div.column", h("div.row.beside-bar", this.title), this.stage.element));
    // The screen itself is there; the portrait comes when it is packed.
    this.display().catch(fail);
    if (this.second) this.openBeside(this.second).catch(fail);
  }

  /** Read the versions; keep what is chosen. */
  async reload() {
    const held = this.version;
    ({ versions: this.versions } = await get(`/api/projects/${this.sitter.id}/versions`));
    if (!this.version) this.chosen = this.versions.at(-1)?.id ?? null;
    this.drawVersions();
    this.drawActions();
    const turned =
      held && this.version && held.id === this.chosen && held.fine !== this.version.fine && this.version.fine;
    if (turned) this.display().catch(fail);
  }

  async display() {
    const { version, stage } = this;
    if (this.first?.id !== version?.id)
      this.first = version && { id: version.id, mix: plainMix(version.mix) };
    this.panel.show(version?.mix ?? STEADY, []);
    const about = await stage.show(version ? { version: version.id } : { style: null });
    if (!about) return;
    this.panel.show(version?.mix ?? STEADY, about.regions ?? []);
    this.panel.element.hidden = !version;
  }

  drawVersions() {
    if (this.title) this.title.textContent = this.version?.name ?? "";
    const focused = document.activeElement?.closest?.("[data-version]")?.dataset.version;
    fill(
      this.list,
      this.versions.map((each) =>
        h(
          "li",
          { "data-version": each.id },
          h(
            "button.version",
            { "aria-pressed": String(each.id === this.chosen), onclick: () => this.choose(each.id) },
            each.thumbnail ? h("img", { slow: each.thumbnail, alt: "" }) : h("span.blank", icon("portrait")),
            h(
              "span",
              h("strong.some", { text: each.name, title: each.name }),
              h("span.small.soft", t(each.fine ? "version.fine" : "version.draft")),
            ),
          ),
          h(
            "div.row.version-tools",
            !each.from_command_line &&
              tool("pencil", t("version.rename", { name: each.name }), () => this.rename(each)),
            !each.from_command_line &&
              tool("trash", t("version.remove", { name: each.name }), () => this.remove(each)),
          ),
        ),
      ),
    );
    if (focused)
      this.list.querySelector(`[data-version="${focused}"] button`)?.focus({ preventScroll: true });
  }

  /** How far the fine version is; a link that somebody presses at this moment stays the same. */
  drawHow() {
    this.how.textContent = t("portrait.making", { how: standingOf(this.making) });
  }

  async choose(id) {
    if (this.open) await this.store().catch(fail);
    this.chosen = id;
    this.drawVersions();
    this.drawActions();
    this.address();
    send("PATCH", `/api/projects/${this.sitter.id}`, { version: id }).then(keepProject).catch(fail);
    await this.display().catch(fail);
  }

  drawActions() {
    const { version } = this;
    const job = version && fineJob(this.sitter.id, version.id);
    this.making = job;
    this.how = h("span");
    if (job) this.drawHow();
    fill(
      this.actions,
      version &&
        (job
          ? h("a.button", { href: `#making/${this.sitter.id}` }, icon("making"), this.how)
          : !version.fine &&
            action(t("portrait.fine"), { kind: "main", drawing: "spark" }, async () => {
              if (this.open) await this.store();
              keepJob(await post(`/api/projects/${this.sitter.id}/versions/${version.id}/fine`));
              say(t("portrait.queued"));
            })),
      version?.style && action(t("portrait.copy"), { drawing: "plus" }, () => this.copy()),
      !version && h("a.button.main", { href: `#style/${this.sitter.id}`, text: t("portrait.choose") }),
      version && !version.style && h("p.small.soft", t("portrait.commands")),
    );
  }

  // ---- sliders -------------------------------------------------------------------------------

  /** A slider is taken: both of its ends on their way to the graphics. */
  begin(ends, name, share) {
    this.stage.ends = false;
    this.stage.share = share;
    if (this.simple(name)) this.stage.expect();
    else if (this.stage.live) this.stage.colors(ends.map(plainMix)).catch(ignore);
  }

  /** Whether photo and painting, which the page has, are both ends. */
  simple(name) {
    const others = { ...plainMix(this.panel.mix), strength: undefined };
    return (
      name === "strength" && this.stage.pair && Object.values(others).every((value) => value === undefined)
    );
  }

  move(mix, share, name) {
    this.open = true;
    if (this.simple(name)) this.stage.strength(mix.strength);
    else this.stage.between(share);
  }

  async end(mix) {
    this.open = true;
    this.panel.mix = mix;
    this.save();
    if (
      this.stage.live &&
      (!this.stage.pair || Object.keys(plainMix(mix)).some((key) => key !== "strength"))
    ) {
      // Between both ends it was nearly right; this is what will be kept.
      this.stage.share = 0;
      await this.stage.colors([plainMix(mix)]).catch(ignore);
    }
  }

  /** Write the mix into the version; a finished one stays, its change becomes a version of its own. */
  async store() {
    this.save.stop();
    const { version } = this,
      mix = plainMix(this.panel.mix);
    this.open = false;
    if (!version?.style || JSON.stringify(mix) === JSON.stringify(plainMix(version.mix))) return;
    const path = `/api/projects/${this.sitter.id}/versions`;
    if (version.fine || version.from_command_line) {
      const made = await post(path, { name: this.free(version.name), style: version.style, mix });
      this.chosen = made.id;
      this.versions.push(made);
      this.address();
      say(t("portrait.new", { name: made.name, old: version.name }));
    } else {
      Object.assign(version, await send("PATCH", `${path}/${version.id}`, { mix }));
    }
    this.drawVersions();
    this.drawActions();
    if (!this.stage.live) await this.refresh(mix);
  }

  /** Without colors alone the page of the portrait is packed again. */
  async refresh(mix) {
    const pure = Object.keys(mix).every((key) => key === "strength");
    if (pure && this.stage.strength(mix.strength ?? 1)) return;
    await this.stage.show({ version: this.chosen });
  }

  free(name) {
    const taken = new Set(this.versions.map((each) => each.name));
    const start = name.replace(/ \d+$/, "");
    for (let n = 2; ; n++) if (!taken.has(`${start} ${n}`)) return `${start} ${n}`;
  }

  /** The new version gets what is shown; the old one is again as it was when it was chosen. */
  async copy() {
    if (this.open) await this.store();
    const name = await this.nameOf(t("portrait.copy"), this.free(this.version.name));
    if (!name) return;
    const old = this.version,
      path = `/api/projects/${this.sitter.id}/versions/${old.id}`;
    const made = await post(`${path}/copy`, { name });
    const moved =
      this.first?.id === old.id && JSON.stringify(this.first.mix) !== JSON.stringify(plainMix(old.mix));
    if (moved && !old.fine && !old.from_command_line) await send("PATCH", path, { mix: this.first.mix });
    await this.reload();
    const shown = this.choose(made.id);
    this.focusChosen();
    await shown;
  }

  /** What had the focus is gone with its dialog: keys go on at the version that is shown. */
  focusChosen() {
    this.list.querySelector("button[aria-pressed=true]")?.focus({ preventScroll: true });
  }

  nameOf(title, value) {
    return nameOf(title, value, t("save"));
  }

  async rename(version) {
    const name = await this.nameOf(t("version.rename", { name: version.name }), version.name);
    if (!name) return;
    await send("PATCH", `/api/projects/${this.sitter.id}/versions/${version.id}`, { name });
    await this.reload();
  }

  async remove(version) {
    const answer = await ask(t("version.remove", { name: version.name }), h("p", t("version.remove.text")), [
      ["yes", t("remove"), "danger"],
    ]);
    if (!answer) return;
    // Asked before: a reload chooses another one, and what was moved belongs to none any more.
    const shown = version.id === this.chosen;
    if (shown) this.save.stop();
    await send("DELETE", `/api/projects/${this.sitter.id}/versions/${version.id}`);
    if (shown) this.open = false;
    await this.reload();
    this.focusChosen();
    if (!shown) return;
    this.address();
    await this.display();
  }

  // ---- two side by side ----------------------------------------------------------------------

  async toggleCompare() {
    if (this.beside) {
      this.beside.close();
      this.beside = null;
      this.second = null;
      this.comparing(false);
      return;
    }
    await this.openBeside(this.versions.find(({ id }) => id !== this.chosen)?.id ?? "photo");
  }

  async openBeside(id) {
    this.beside = new Beside(this.sitter, this.stage, this.versions, (picked) => {
      this.second = picked;
      this.address();
    });
    this.comparing(true);
    this.stages.append(this.beside.element);
    await this.beside.show(id);
  }

  comparing(yes) {
    this.compare.setAttribute("aria-pressed", String(yes));
    this.stages.classList.toggle("two", yes);
    this.title.textContent = this.version?.name ?? "";
    this.address();
  }

  /** What is seen stands in the address, so that a reload shows it again. */
  address() {
    const parts = ["portrait", this.sitter.id, this.chosen ?? "", this.second ?? ""].join("/");
    history.replaceState(null, "", `#${parts.replace(/\/+$/, "")}`);
  }
}
