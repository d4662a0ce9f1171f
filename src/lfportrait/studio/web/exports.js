// Files of a portrait: what each is for and how large; those that are made; lists for studies and batches.

import { get, post, send } from "./api.js";
import { ask, button, fill, fresh, h, icon } from "./dom.js";
import { known, said, size, t } from "./i18n.js";
import { doing, fail, say } from "./shell.js";
import { isLive, jobsOf, keepJob, on, state } from "./state.js";

const GROUPS = {
  panel: ["coded", "quilt", "hop", "rgbd", "stereo", "anaglyph"],
  screen: ["page", "sweep", "flat", "print"],
  solid: ["glb", "usdz", "obj", "ply"],
  splats: ["splats_ply", "spz", "sog"],
  further: ["field", "checkpoint"],
};

export class Exports {
  /** @param {function} about Gives version, display and placement. */
  constructor(sitter, about, display) {
    this.sitter = sitter;
    this.about = about;
    this.display = display;
    this.made = h("section.stack", { "aria-label": t("files.made") });
    this.kinds = h("div.stack.wide");
    this.element = h("div.stack.wide", {}, this.made, this.kinds, this.selection());
    this.ends = [
      on("exports", ({ project: which }) => which === sitter.id && this.readMade().catch(fail)),
      on("job", (job) => job.project === sitter.id && job.kind === "export" && this.drawMade()),
      on("progress", ({ job }) => this.running().some(({ id }) => id === job) && this.drawMade()),
    ];
  }

  close() {
    for (const end of this.ends) end();
  }

  setVersion() {}

  async load() {
    await this.readMade();
    const left = new Map(this.about_.kinds.map((kind) => [kind.kind, kind]));
    fill(
      this.kinds,
      Object.entries(GROUPS).map(([group, names]) => {
        const some = names.map((name) => left.get(name)).filter(Boolean);
        return (
          some.length > 0 &&
          h(
            "section.stack",
            {},
            h("h2", { text: t(`files.${group}`) }),
            h(
              "ul.kinds-grid",
              {},
              some.map((kind) => this.kind(kind)),
            ),
          )
        );
      }),
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

  drawMade() {
    const { exports: files } = this.about_,
      running = this.running();
    this.made.hidden = !files.length && !running.length;
    fill(
      this.made,
      h("h2", { text: t("files.made") }),
      h(
        "ul.files",
        {},
        running.map((job) =>
          h(
            "li.card.row.between",
            {},
            h(
              "div",
              {},
              h("strong", { text: known("file", job.export ?? "", job.name ?? "") }),
              " ",
              h("span.small.soft", { text: job.error ? said(job.error.message) : t(`job.${job.state}`) }),
            ),
            job.state === "failed"
              ? button(
                  "",
                  doing(async () => {
                    await send("DELETE", `/api/jobs/${job.id}`);
                    state.jobs = state.jobs.filter(({ id }) => id !== job.id);
                    this.drawMade();
                  }),
                  { kind: "quiet tool", drawing: "close", name: t("close") },
                )
              : h(
                  "div.row",
                  {},
                  h("progress", { max: 1, value: job.progress, "aria-label": t("files.making") }),
                  button(
                    "",
                    doing(async () => keepJob(await post(`/api/jobs/${job.id}/cancel`))),
                    { kind: "quiet tool", drawing: "close", name: t("job.cancel") },
                  ),
                ),
          ),
        ),
        [...files]
          .sort((one, other) => other.created - one.created)
          .map((file) =>
            h(
              "li.card.row.between",
              {},
              h(
                "div",
                {},
                h("strong", { text: file.name }),
                " ",
                h("span.small.soft", {
                  text: `${size(file.size_bytes)}${file.fine ? "" : ` · ${t("version.draft")}`}`,
                }),
                h("p.small.soft.path", { text: file.path }),
              ),
              h(
                "div.row",
                {},
                file.kind === "quilt" &&
                  button(
                    t("files.cast"),
                    doing(async () => {
                      await post(`/api/projects/${this.sitter.id}/exports/${file.id}/cast`, { screen: -1 });
                      say(t("files.casted"));
                    }),
                    { drawing: "show" },
                  ),
                h("a.button", { href: file.file, download: file.name }, icon("download"), t("files.save")),
                button(
                  "",
                  doing(async () => {
                    await send("DELETE", `/api/projects/${this.sitter.id}/exports/${file.id}`);
                    await this.readMade();
                  }),
                  { kind: "quiet tool", drawing: "trash", name: t("files.remove", { name: file.name }) },
                ),
              ),
            ),
          ),
      ),
    );
  }

  kind(kind) {
    return h(
      "li.card.kind-card",
      {},
      h("h3", { text: known("file", kind.kind, kind.title) }),
      h("p.small.soft", { text: known("purpose", kind.kind, kind.purpose) }),
      h(
        "div.row.between",
        {},
        h("span.small.soft", {
          text: `${kind.suffix} · ${t("files.about", { size: size(kind.about_bytes) })}`,
        }),
        button(
          t("files.make"),
          doing(() => this.make(kind)),
          { "aria-label": t("files.make.one", { name: known("file", kind.kind, kind.title) }) },
        ),
      ),
    );
  }

  /** Ask for options where there are some, then make it. */
  async make(kind) {
    const values = Object.fromEntries(kind.options.map((option) => [option.name, option.default]));
    const name = h("input", {
      type: "text",
      value: this.sitter.name,
      maxlength: 80,
      required: true,
      autocomplete: "off",
    });
    const answer = await ask(
      known("file", kind.kind, kind.title),
      h(
        "div.stack",
        {},
        h("p.soft", { text: known("purpose", kind.kind, kind.purpose) }),
        kind.needs_display && h("p.small", { text: t("files.display", { name: this.display().name }) }),
        h("label.field", {}, h("span", { text: t("name") }), name),
        kind.options.map((option) => this.option(option, values)),
      ),
      [
        ["", t("cancel")],
        ["yes", t("files.make"), "main"],
      ],
    );
    if (!answer) return;
    keepJob(
      await post(`/api/projects/${this.sitter.id}/exports`, {
        kind: kind.kind,
        ...this.about(),
        options: values,
        name: name.value.trim(),
      }),
    );
    this.made.hidden = false;
    this.drawMade();
    this.made.scrollIntoView({ block: "nearest" });
  }

  option({ name, type, choices, min, max }, values) {
    const id = fresh("option");
    const put = (value) => {
      values[name] = value;
    };
    if (type === "bool")
      return h(
        "label.check",
        { for: id },
        h("input", {
          id,
          type: "checkbox",
          ".checked": values[name],
          onchange: (event) => put(event.target.checked),
        }),
        h("code", { text: name }),
      );
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
            type: type === "number" ? "number" : "text",
            value: values[name],
            min,
            max,
            step: "any",
            oninput: (event) => put(type === "number" ? Number(event.target.value) : event.target.value),
          });
    return h("div.field", {}, h("label", { for: id }, h("code", { text: name })), input);
  }

  /** Versions of all sitters, for a batch or a study. */
  selection() {
    const list = h("ul.stack.tight"),
      chosen = new Map(),
      result = h("div.stack", { role: "status" });
    const whole = h(
      "details.card",
      {
        ontoggle: doing(async () => {
          if (!whole.open || list.children.length) return;
          for (const sitter of state.projects) {
            const { versions } = await get(`/api/projects/${sitter.id}/versions`);
            list.append(
              ...versions.map((version) => {
                const id = fresh("pick");
                return h(
                  "li",
                  {},
                  h(
                    "label.check",
                    { for: id },
                    h("input", {
                      id,
                      type: "checkbox",
                      onchange: (event) => {
                        if (event.target.checked)
                          chosen.set(`${sitter.id} ${version.id}`, [sitter.id, version]);
                        else chosen.delete(`${sitter.id} ${version.id}`);
                      },
                    }),
                    `${sitter.name}: ${version.name}`,
                  ),
                );
              }),
            );
          }
        }),
      },
      h("summary", {}, h("strong", { text: t("select.title") })),
      h(
        "div.stack",
        {},
        h("p.soft", { text: t("select.text") }),
        list,
        h(
          "div.row",
          {},
          button(
            t("select.batch"),
            doing(async () => {
              const picked = this.picked(chosen);
              const unique = (values) => [...new Set(values)];
              this.tell(
                result,
                await post("/api/batch", {
                  projects: unique(picked.map(([id]) => id)),
                  styles: unique(picked.map(([, { style }]) => style)),
                  displays: [this.display().id],
                  versions: picked.map(([id, version]) => [id, version.id]),
                }),
              );
            }),
          ),
          button(
            t("select.study"),
            doing(async () => {
              this.tell(
                result,
                await post("/api/study", {
                  versions: this.picked(chosen).map(([id, version]) => [id, version.id]),
                  title: this.sitter.name,
                }),
              );
            }),
          ),
        ),
        result,
      ),
    );
    return whole;
  }

  picked(chosen) {
    if (!chosen.size) throw Object.assign(new Error(t("select.none")), { code: "none" });
    return [...chosen.values()];
  }

  tell(box, { file, command, text }) {
    fill(
      box,
      h("p", {}, t("select.written"), " ", h("code", { text: file })),
      h("p", {}, t("select.command"), " ", h("code.command", { text: command })),
      h("pre.small", { text, tabindex: 0, "aria-label": file }),
    );
  }
}
