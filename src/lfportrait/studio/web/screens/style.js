// Screen 4: paintings, each seen on this sitter; which face, its landmarks, its regions.

import { get, picture, post, put, send } from "../api.js";
import { ask, fill, h, heading, icon } from "../dom.js";
import { said, t } from "../i18n.js";
import { chooser, takeFiles } from "../drop.js";
import { plainName } from "../uploads.js";
import { chooseFace } from "../faces.js";
import { growingPicture, quickPicture, slowly, slowPicture } from "../lane.js";
import { action, fail, murmur, say, tool } from "../shell.js";
import { keepProject, on } from "../state.js";
import { showLandmarks } from "./landmarking.js";
import { showRegions } from "./painting.js";

export async function showStyle(root, sitter, [style, what]) {
  if (style && what === "landmarks") return showLandmarks(root, sitter, style);
  if (style && what === "regions") return showRegions(root, sitter, style);
  const screen = new Gallery(root, sitter, style);
  await screen.load();
  return () => screen.close();
}

/** How a painting's picture is shown: a file is only read, a built-in one is painted first. */
const shown = (style) => (style.kind === "builtin" ? slowPicture : quickPicture);

class Gallery {
  constructor(root, sitter, style) {
    this.sitter = sitter;
    this.chosen = style || sitter.style;
    this.grid = h("ul.paintings", { "aria-label": t("style.gallery") });
    this.detail = h("section.detail", { "aria-label": t("style.chosen") });
    this.missing = h("div");
    this.stopper = new AbortController();
    this.queue = [];
    fill(
      root,
      heading(t("step.style"), h("p.lead", t("style.lead")), this.adding()),
      this.missing,
      h("div.style-body", this.detail, this.grid),
    );
    // A preview is asked for when its painting is in sight.
    this.sight = new IntersectionObserver(
      (seen) => {
        for (const { target, isIntersecting } of seen) if (isIntersecting) this.want(target.dataset.style);
      },
      { rootMargin: "200px" },
    );
    this.ends = [
      on("styles", ({ project: which }) => (!which || which === sitter.id) && this.load().catch(fail)),
      on("project", (item) => item.id === sitter.id && this.renew(item)),
      takeFiles(t("style.release"), (files, pasted) => this.add(files, pasted)),
    ];
  }

  close() {
    for (const end of this.ends) end();
    this.stopper.abort();
    this.sight.disconnect();
  }

  /** The sitter as it is now; with a head, paintings are seen on it. */
  renew(sitter) {
    const before = this.sitter.has.field;
    this.sitter = sitter;
    if (sitter.has.field !== before) this.load().catch(fail);
  }

  async load() {
    ({ styles: this.styles } = await get(`/api/styles?project=${this.sitter.id}`));
    if (!this.style()) this.chosen = this.styles[0]?.id ?? null;
    else if (this.chosen !== this.sitter.style) this.keep();
    const { id, name, has } = this.sitter;
    fill(
      this.missing,
      !has.field &&
        h(
          "p.note.fair",
          icon("fair"),
          h(
            "span",
            t("style.nohead", { sitter: name }),
            " ",
            h("a", { href: `#making/${id}`, text: t("photos.next") }),
          ),
        ),
    );
    // The large picture is asked for before the small ones.
    this.drawDetail();
    this.draw();
  }

  adding() {
    const files = { accept: "image/*,.heic,.heif,.avif", multiple: true, id: "painting-files" };
    return h(
      "div.row",
      chooser(t("style.add"), { kind: "main", drawing: "plus" }, files, (chosen) => this.add(chosen)),
      action(t("style.paste"), { drawing: "paste" }, () => this.paste()),
    );
  }

  /** The clipboard's picture, by a button; Ctrl+V does the same. */
  async paste() {
    const items = await navigator.clipboard.read().catch(() => []);
    for (const item of items) {
      const type = item.types.find((each) => each.startsWith("image/"));
      if (type) return this.add([new File([await item.getType(type)], "pasted.png", { type })], true);
    }
    say(t("style.nopicture"));
  }

  async add(files, pasted = false) {
    for (const file of files) {
      try {
        const name = pasted ? "pasted.png" : plainName(file.name);
        murmur(t("style.adding", { name }));
        const style = await put(
          `/api/styles?name=${encodeURIComponent(name)}&project=${this.sitter.id}`,
          file,
        );
        this.chosen = style.id;
        this.keep();
        await this.load();
        await this.greet(style);
      } catch (error) {
        fail(error);
      }
    }
  }

  /** A painting that has come: its faces are looked for now, before all pictures of the gallery. */
  async greet({ id, landmarks, name }) {
    const path = `/api/styles/${id}/faces?project=${this.sitter.id}`;
    const { faces } = landmarks === "file" ? { faces: [0] } : await get(path, this.stopper.signal);
    // What was found stands in the gallery, too.
    if (faces.length !== 1) await this.load();
    if (faces.length > 1) await this.faces(this.style(id));
    else if (!faces.length) say(t("style.noface", { name }), { wrong: true });
    else say(t("style.added", { name }));
  }

  draw() {
    const focused = document.activeElement?.closest?.("[data-style]")?.dataset.style;
    this.sight.disconnect();
    fill(
      this.grid,
      this.styles.map((style) => this.card(style)),
    );
    for (const each of this.grid.children) this.sight.observe(each);
    if (focused) this.grid.querySelector(`[data-style="${focused}"] button`)?.focus({ preventScroll: true });
  }

  card(style) {
    return h(
      "li",
      { "data-style": style.id },
      h(
        "button.painting",
        { "aria-pressed": String(style.id === this.chosen), onclick: () => this.choose(style.id) },
        h(
          "span.pair",
          { class: this.sitter.has.field ? "" : "alone" },
          shown(style)(h("img", { alt: "" }), style.picture),
          this.sitter.has.field &&
            (style.preview ? h("img.on-sitter", { src: style.preview, alt: "" }) : h("span.on-sitter.blank")),
        ),
        h("span.name", { text: style.name, title: style.name }),
        style.kind === "builtin" && h("span.unseen", t("style.builtin")),
      ),
    );
  }

  /** What is chosen stays so on other screens, and after a reload. */
  keep() {
    const style = this.chosen;
    keepProject({ ...this.sitter, style });
    send("PATCH", `/api/projects/${this.sitter.id}`, { style }).then(keepProject).catch(fail);
  }

  choose(id) {
    this.chosen = id;
    for (const each of this.grid.children)
      each.firstChild.setAttribute("aria-pressed", String(each.dataset.style === id));
    this.drawDetail();
    this.keep();
  }

  style(id = this.chosen) {
    return this.styles.find((each) => each.id === id);
  }

  /** Ask for a painting's picture on this sitter, one after another, the chosen one first. */
  want(id) {
    if (!this.sitter.has.field || !this.style(id) || this.style(id).preview || this.queue.includes(id))
      return;
    if (id === this.chosen) this.queue.unshift(id);
    else this.queue.push(id);
    this.busy ??= this.work().finally(() => {
      this.busy = null;
    });
  }

  async work() {
    while (this.queue.length && !this.stopper.signal.aborted) {
      const id = this.queue.shift(),
        style = this.style(id);
      if (!style || style.preview || style.landmarks === "none") continue;
      try {
        // The server keeps it: its address stands in the gallery from then on.
        const { signal } = this.stopper;
        const path = `/api/projects/${this.sitter.id}/preview`;
        await slowly(() => picture(path, { style: id }, signal), signal);
        const { styles } = await get(`/api/styles?project=${this.sitter.id}`);
        style.preview = styles.find((each) => each.id === id)?.preview ?? null;
        if (!style.preview) continue;
        this.grid
          .querySelector(`[data-style="${id}"] .on-sitter`)
          ?.replaceWith(h("img.on-sitter", { src: style.preview, alt: "" }));
        if (id === this.chosen) this.drawDetail();
      } catch (error) {
        if (error.name === "AbortError") return;
        // What is wrong with the painting itself stands below it.
        if (id === this.chosen && error.code !== "user_error") fail(error);
      }
    }
  }

  drawDetail() {
    const style = this.style();
    if (!style) return fill(this.detail, h("div.empty", icon("style"), h("p", t("style.none"))));
    const here = `#style/${this.sitter.id}/${style.id}`;
    const own = style.kind !== "builtin";
    const facts = h("ul.stack.facts");
    fill(
      this.detail,
      this.both(style),
      h(
        "div.row",
        this.sitter.has.field &&
          style.landmarks !== "none" &&
          action(t("style.use"), { kind: "main", drawing: "portrait" }, () => this.use(style)),
        own
          ? h("a.button", { href: `${here}/landmarks` }, icon("points"), t("style.landmarks"))
          : action(t("style.copy"), { drawing: "points" }, () => this.copy(style)),
        own && h("a.button", { href: `${here}/regions` }, icon("brush"), t("style.regions")),
        own &&
          style.faces > 1 &&
          action(t("style.faces", { n: style.faces }), { drawing: "sitters" }, () => this.faces(style)),
        own && tool("trash", t("style.remove", { name: style.name }), () => this.remove(style)),
      ),
      facts,
    );
    this.want(style.id);
    this.judge(style, facts).catch(fail);
  }

  /** The painting, and once there is a head the sitter in it. */
  both(style) {
    const { name, has } = this.sitter;
    const seen = has.field && style.landmarks !== "none"; // without a face nothing will come
    const painting = h("img", { alt: t("style.alt", { name: style.name }) });
    return h(
      "div.both",
      { class: seen ? "" : "alone" },
      h(
        "figure",
        growingPicture(painting, style.picture, style.full, shown(style)),
        h("figcaption.soft.small", style.name),
      ),
      seen &&
        h(
          "figure",
          style.preview
            ? h("img", { src: style.preview, alt: t("preview.alt", { sitter: name, name: style.name }) })
            : h(
                "div.blank",
                { role: "img", "aria-label": t("preview.wait") },
                icon("spark"),
                h("span.small", t("preview.wait")),
              ),
          h("figcaption.soft.small", name),
        ),
    );
  }

  /** What the painting will give: it takes a second the first time. */
  async judge(style, list) {
    const path = `/api/styles/${style.id}/check?project=${this.sitter.id}`;
    const { signal } = this.stopper;
    const { facts } = await slowly(() => get(path, signal), signal).catch((error) => {
      // Without a face the commands' message names their options.
      const text = style.landmarks === "none" ? t("style.noface", { name: style.name }) : error.message;
      if (error.code === "user_error") return { facts: [{ grade: "bad", text }] };
      throw error;
    });
    fill(
      list,
      facts.map(({ grade, text }) =>
        h("li.note.small", { class: grade }, icon(grade), h("span", said(text))),
      ),
    );
  }

  async faces(style) {
    if (await chooseFace(this.sitter, style)) await this.load();
  }

  /** A painting that comes with the program is copied before it is changed. */
  async copy(style) {
    const made = await post(`/api/styles/${style.id}/copy?project=${this.sitter.id}`);
    location.hash = `#style/${this.sitter.id}/${made.id}/landmarks`;
  }

  async remove(style) {
    const answer = await ask(t("style.remove", { name: style.name }), h("p", t("style.remove.text")), [
      ["yes", t("remove"), "danger"],
    ]);
    if (!answer) return;
    await send("DELETE", `/api/styles/${style.id}?project=${this.sitter.id}`);
    await this.load();
  }

  /** A version of the portrait in this style. */
  async use(style) {
    const { versions } = await get(`/api/projects/${this.sitter.id}/versions`);
    const names = new Set(versions.map(({ name }) => name));
    let name = style.name;
    for (let n = 2; names.has(name); n++) name = `${style.name} ${n}`;
    const made =
      versions.find(
        (each) => each.style === style.id && !each.from_command_line && !Object.keys(each.mix ?? {}).length,
      ) ?? (await post(`/api/projects/${this.sitter.id}/versions`, { name, style: style.id, mix: {} }));
    keepProject(
      await send("PATCH", `/api/projects/${this.sitter.id}`, { style: style.id, version: made.id }),
    );
    location.hash = `#portrait/${this.sitter.id}/${made.id}`;
  }
}
