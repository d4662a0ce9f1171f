// A second portrait beside the first: another version, or the photographed head, seen from the same place.

import { check, h } from "./dom.js";
import { t } from "./i18n.js";
import { fail } from "./shell.js";
import { linkCameras, Stage } from "./stage.js";

export class Beside {
  /**
   * @param {Stage} first
   * @param {object[]} versions
   * @param {function} onpick Called with the id of what is shown: a version's, or "photo".
   */
  constructor(sitter, first, versions, onpick) {
    Object.assign(this, { first, onpick, linked: true });
    this.stage = new Stage(sitter, t("portrait.beside"));
    this.picker = h(
      "select",
      { "aria-label": t("portrait.beside"), onchange: () => this.show(this.picker.value).catch(fail) },
      versions.map((each) => h("option", { value: each.id, text: each.name })),
      h("option", { value: "photo", text: t("portrait.photo") }),
    );
    const follow = (linked) => {
      this.linked = linked;
      this.link();
    };
    this.element = h(
      "div.column",
      h(
        "div.row.between.beside-bar",
        this.picker,
        check({ id: "linked", checked: true, small: true, onchange: follow }, t("portrait.link")),
      ),
      this.stage.element,
    );
  }

  async show(id) {
    this.picker.value = id;
    this.onpick(id);
    await this.stage.show(id === "photo" ? { style: null } : { version: id });
    this.link();
  }

  link() {
    this.unlink?.();
    this.unlink = this.linked ? linkCameras(this.first, this.stage) : null;
  }

  close() {
    this.unlink?.();
    this.stage.close();
    this.element.remove();
  }
}
