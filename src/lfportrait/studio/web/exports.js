// Files of a portrait: what each is for and how large, and those that are made.

import { get, post, send } from "./api.js";
import { ask, check, fill, fresh, h, icon } from "./dom.js";
import { known, said, size, t } from "./i18n.js";
import { answered } from "./naming.js";
import { action, fail, say, tool } from "./shell.js";
import { selection } from "./selection.js";
import { fineJob, isLive, jobsOf, keepJob, on, state } from "./state.js";
import { leftOfJob } from "./times.js";

// Refusals that something else in the dialog is the answer to.
const TYPED = ["bad_request", "bad_name", "exists", "user_error"];

export class Exports {
  /**
   * @param {function} about Gives the ids of version and display, and the placement.
   * @param {function} display Gives the panel.
   * @param {function} version Gives the version.
   * @param {function} nameOf Gives the name of a version by its id, "" where it is gone.
   */
  constructor(sitter, about, display, version, nameOf) {
    Object.assign(this, { sitter, about, display, version, nameOf, parts: new Map() });
    this.made = h("section.stack", { "aria-label": t("files.made") });
    this.kinds = h("div.stack.wide");
    this.element = h("div.stack.wide", this.made, this.kinds, selection(sitter, display));
    this.ends = [
      on("exports", ({ project: which }) => which === sitter.id && this.readMade().catch(fail)),
      on("job", (job) => {
        if (job.project === sitter.id && ["export", "fine"].includes(job.kind)) this.drawMade();
      }),
      on("progress", ({ job }) => this.drawHow(job)),
    ];
  }

  close() {
    for (const end of this.ends) end();
  }

  async load() {
    await this.readMade();
    const kinds = this.about_.kinds;
    fill(
      this.kinds,
      [...new Set(kinds.map(({ group }) => group))].map((group) =>
        h(
          "section.stack",
          h("h2", known("files", group)),
          h(
            "ul.kinds-grid",
            kinds.filter((kind) => kind.group === group).map((kind) => this.kind(kind)),
          ),
        ),
      ),
    );
  }

  async readMade() {
    this.about_ = await get(`/api/projects/${this.sitter.id}/exports`);
    this.drawMade();
  }

  running() {
    return jobsOf(this.sitter.id).filter(
      (job) => job.kind === "export" && (isLive(job) || job.state === "failed"),
    );
  }

  /** How far a file is, that is not there yet. */
  standing(job) {
    if (job.error) return said(job.error.message);
    const other = state.jobs.find(({ id }) => id === job.after);
    if (job.state === "waiting" && other && isLive(other)) return t("files.waits");
    return [t(`job.${job.state}`), job.state === "running" && leftOfJob(job)].filter(Boolean).join(" · ");
  }

  /** What a kind is called; by its short name where it is gone. */
  title(kind) {
    return said(this.about_.kinds.find((one) => one.kind === kind)?.title ?? kind ?? "");
  }

  /** What a file is, of which version, and whether that was a preview. */
  kindOf(kind, version, fine) {
    return [this.title(kind), this.nameOf(version), !fine && t("version.draft")].filter(Boolean).join(" · ");
  }

  /** How far a file is; a button that somebody presses at this moment stays the same. */
  drawHow(id) {
    const job = this.running().find((each) => each.id === id),
      part = this.parts.get(id);
    if (!job || !part) return;
    part.how.textContent = this.standing(job);
    if (job.progress === null) part.bar.removeAttribute("value");
    else part.bar.value = job.progress;
  }

  drawMade() {
    if (!this.about_) return;
    const { exports: files } = this.about_,
      running = this.running();
    this.made.hidden = !files.length && !running.length;
    this.parts = new Map(
      running.map((job) => [
        job.id,
        { how: h("span.small.soft"), bar: h("progress", { max: 1, "aria-label": t("files.making") }) },
      ]),
    );
    for (const job of running) this.drawHow(job.id);
    fill(
      this.made,
      h("h2", t("files.made")),
      h(
        "ul.files",
        running.map((job) =>
          h(
            "li.card.row.between",
            h(
              "div",
              h("strong", job.title ?? this.title(job.export)),
              " ",
              this.parts.get(job.id).how,
              h("p.small.soft", this.kindOf(job.export, job.version, job.quality !== "preview")),
            ),
            job.state === "failed"
              ? h(
                  "div.row",
                  action(t("job.resume"), { drawing: "play" }, async () =>
                    keepJob(await post(`/api/jobs/${job.id}/resume`)),
                  ),
                  tool("close", t("close"), async () => {
                    await send("DELETE", `/api/jobs/${job.id}`);
                    state.jobs = state.jobs.filter(({ id }) => id !== job.id);
                    this.drawMade();
                  }),
                )
              : h(
                  "div.row",
                  job.state !== "waiting" && this.parts.get(job.id).bar,
                  tool("close", t("job.cancel"), async () =>
                    keepJob(await post(`/api/jobs/${job.id}/cancel`)),
                  ),
                ),
          ),
        ),
        [...files]
          .sort((one, other) => other.created - one.created)
          .map((file) =>
            h(
              "li.card.row.between",
              h(
                "div",
                h("strong", file.name),
                " ",
                h("span.small.soft", size(file.size_bytes)),
                h("p.small.soft", this.kindOf(file.kind, file.version, file.fine)),
                h("p.small.soft.path", file.path),
              ),
              h(
                "div.row",
                file.kind === "quilt" &&
                  action(t("files.cast"), { drawing: "show" }, async () => {
                    await post(`/api/projects/${this.sitter.id}/exports/${file.id}/cast`, { screen: -1 });
                    say(t("files.casted"));
                  }),
                h("a.button", { href: file.file, download: file.name }, icon("download"), t("files.save")),
                tool("trash", t("files.remove", { name: file.name }), async () => {
                  await send("DELETE", `/api/projects/${this.sitter.id}/exports/${file.id}`);
                  await this.readMade();
                  // The last one is gone: on with what can be made.
                  if (!this.about_.exports.length) this.kinds.querySelector("button")?.focus();
                }),
              ),
            ),
          ),
      ),
    );
  }

  kind(kind) {
    return h(
      "li.card.kind-card",
      h("h3", said(kind.title)),
      h("p.small.soft", said(kind.purpose)),
      h(
        "div.row.between",
        h(
          "span.small.soft",
          [kind.suffix, kind.about_bytes && t("files.about", { size: size(kind.about_bytes, 0) })]
            .filter(Boolean)
            .join(" · "),
        ),
        action(t("files.make"), { "aria-label": t("files.make.one", { name: said(kind.title) }) }, () =>
          this.make(kind),
        ),
      ),
    );
  }

  /** Ask for options where there are some, then make it: what is refused is asked for again. */
  async make(kind) {
    const values = Object.fromEntries(kind.options.map((option) => [option.name, option.default]));
    const name = h("input", {
      type: "text",
      value: this.sitter.name,
      maxlength: 80,
      required: true,
      autocomplete: "off",
    });
    const order = (answer) =>
      post(`/api/projects/${this.sitter.id}/exports`, {
        kind: kind.kind,
        ...this.about(),
        options: values,
        fine: answer === "fine",
        name: name.value.trim(),
      });
    const job = await answered((wrong) => this.choices(kind, name, values, wrong), order, TYPED);
    if (!job) return;
    keepJob(job);
    this.made.hidden = false;
    this.drawMade();
    this.made.scrollIntoView({ block: "nearest" });
  }

  /** The dialog of a file's name and options; which of its buttons was pressed, "" for none. */
  choices(kind, name, values, wrong) {
    const { fine, from_command_line: given, id } = this.version();
    const first = !fine && !given && t(fineJob(this.sitter.id, id) ? "files.wait" : "files.fine.first");
    return ask(
      said(kind.title),
      h(
        "div.stack",
        wrong && h("p.note.bad", { role: "alert" }, icon("bad"), wrong),
        h("p.soft", said(kind.purpose)),
        kind.needs_display && h("p.small", t("files.display", { name: this.display().name })),
        !fine && h("p.note.fair", icon("fair"), t("files.draft")),
        h("label.field", h("span", t("name")), name),
        kind.options.map((option) => this.option(option, values)),
      ),
      [
        ...(first ? [["fine", first, "main"]] : []),
        ["yes", t(fine ? "files.make" : "files.draft.make"), first ? "" : "main"],
      ],
    );
  }

  option({ name, note, type, choices, min, max }, values) {
    const id = fresh("option");
    const put = (value) => {
      values[name] = value;
    };
    if (type === "bool") return check({ id, checked: values[name], onchange: put }, h("code", name));
    const isNumber = type === "number" || type === "whole";
    const input =
      type === "choice"
        ? h(
            "select",
            { id, onchange: (event) => put(event.target.value) },
            choices.map((choice) =>
              h("option", { value: choice, text: choice, selected: choice === values[name] }),
            ),
          )
        : h("input", {
            id,
            type: isNumber ? "number" : "text",
            value: values[name],
            required: isNumber,
            "aria-describedby": `${id}-note`,
            min,
            max,
            step: type === "whole" ? 1 : "any",
            oninput: (event) => put(isNumber ? Number(event.target.value) : event.target.value),
          });
    return h(
      "div.field",
      h("label", { for: id }, h("code", name)),
      input,
      h("small.soft", { id: `${id}-note`, text: said(note) }),
    );
  }
}
