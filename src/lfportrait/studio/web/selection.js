// Versions of all sitters, for a batch or a study.

import { get, post } from "./api.js";
import { check, fill, fresh, h, icon } from "./dom.js";
import { said, t } from "./i18n.js";
import { action, doing } from "./shell.js";
import { state } from "./state.js";

/**
 * @param {object} sitter
 * @param {function} display Gives the chosen panel.
 */
export function selection(sitter, display) {
  const list = h("ul.stack.tight"),
    chosen = new Map(),
    result = h("div.stack", { role: "status" });
  const whole = h(
    "details.card",
    {
      ontoggle: doing(async () => {
        if (!whole.open) return;
        // Read each time: there may be more by now.
        const all = await Promise.all(state.projects.map((each) => get(`/api/projects/${each.id}/versions`)));
        fill(list);
        for (const [index, { versions }] of all.entries()) {
          const each = state.projects[index];
          list.append(
            ...versions.map((version) => {
              const id = fresh("pick"),
                key = `${each.id} ${version.id}`;
              return h(
                "li",
                check(
                  {
                    id,
                    checked: chosen.has(key),
                    onchange: (yes) => (yes ? chosen.set(key, [each.id, version.id]) : chosen.delete(key)),
                  },
                  `${each.name}: ${version.name}${version.fine ? "" : ` (${t("version.draft")})`}`,
                ),
              );
            }),
          );
        }
      }),
    },
    h("summary", h("strong", t("select.title"))),
    h(
      "div.stack",
      h("p.soft", t("select.text")),
      list,
      h(
        "div.row",
        action(t("select.batch"), {}, async () => {
          // Each sitter in the style of the version that was chosen, not in all of them.
          const versions = picked(chosen);
          show(result, "batch", await post("/api/batch", { displays: [display().id], versions }));
        }),
        action(t("select.study"), {}, async () => {
          const versions = picked(chosen);
          const alone = versions.every(([id]) => id === sitter.id);
          show(result, "study", await post("/api/study", { versions, title: alone ? sitter.name : "" }));
        }),
      ),
      result,
    ),
  );
  return whole;
}

/** Ids of sitter and version of what is chosen. */
function picked(chosen) {
  if (!chosen.size) throw Object.assign(new Error(t("select.none")), { code: "none" });
  return [...chosen.values()];
}

/** What was written, what to do with it now, and where the result will be. */
function show(box, kind, { file, command, text, out, page, notes }) {
  fill(
    box,
    h("p", t("select.written"), " ", h("code.path", file)),
    (notes ?? []).map((note) => h("p.note.small", icon("info"), said(note))),
    h("p", t("select.run")),
    h("pre.small.command", { text: command, tabindex: 0, "aria-label": t("select.run") }),
    h("p", t(`select.${kind}.then`), " ", h("code.path", kind === "batch" ? `${out}/index.html` : page)),
    // The study's file is the command itself.
    text.trim() !== command &&
      h(
        "details",
        h("summary", t("select.contents")),
        h("pre.small", { text, tabindex: 0, "aria-label": file }),
      ),
  );
}
