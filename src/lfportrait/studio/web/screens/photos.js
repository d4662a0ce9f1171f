// Screen 2: photos in, what is wrong with each, where they were taken from, what to do.

import { get, post, send } from "../api.js";
import { drawArc } from "../arc.js";
import { button, fill, h, heading, icon } from "../dom.js";
import { chooser, takeFiles } from "../drop.js";
import { known, said, size, t } from "../i18n.js";
import { action, fail, murmur, say, tool } from "../shell.js";
import { isLive, jobsOf, keepJob, on, project } from "../state.js";
import { uploadsOf } from "../uploads.js";

const KINDS = ".jpg,.jpeg,.png,.webp,.tif,.tiff,.bmp,.avif,.heic,.heif,.hif,.mp4,.mov,.m4v,.avi,.mkv,.webm";
const MARKS = { green: "good", yellow: "fair", red: "bad" };

export async function showPhotos(root, sitter) {
  const screen = new Photos(root, sitter.id);
  await screen.load();
  return () => screen.close();
}

class Photos {
  constructor(root, id) {
    this.id = id;
    this.asked = this.drawn = 0;
    this.uploads = uploadsOf(id);
    this.filter = "all";
    this.way = h("div", { "aria-live": "off" });
    this.arc = h("div");
    this.advice = h("div.stack");
    this.heading = h("div.row.between");
    this.sheet = h("ul.sheet", { "aria-label": t("photos.sheet") });
    this.next = h("div.row");
    fill(
      root,
      heading(t("step.photos"), h("p.lead", t("photos.lead")), this.next),
      this.zone(),
      this.way,
      h("div.judged", this.arc, this.advice),
      this.heading,
      this.sheet,
    );
    this.ends = [
      on("photos", ({ project: which }) => which === id && this.load().catch(fail)),
      on("project", (item) => item.id === id && this.drawNext()),
      on("progress", ({ job, progress }) => {
        const checking = this.data?.checking;
        if (!checking || checking.job !== job) return;
        checking.done = Math.round((progress ?? 0) * checking.total);
        this.drawHeading();
      }),
      this.uploads.watch(() => this.drawWay()),
      takeFiles(t("photos.release"), (list) => this.take(list)),
    ];
  }

  close() {
    for (const end of this.ends) end();
  }

  async load() {
    const mine = ++this.asked;
    const data = await get(`/api/projects/${this.id}/photos`);
    // Answers may come in another order than they were asked for; an older one is out of date.
    if (mine < this.drawn) return;
    this.drawn = mine;
    this.data = data;
    this.draw();
  }

  /** Send files that were chosen, dropped or pasted. */
  take(files) {
    if (!files.length) return say(t("photos.nothing"));
    this.uploads
      .add(files)
      .then(() => this.load())
      .catch(fail);
  }

  /** Where photos are chosen; they are dropped anywhere. */
  zone() {
    const take = (files) => this.take(files);
    const files = { multiple: true, accept: KINDS, id: "photo-files" },
      folder = { multiple: true, webkitdirectory: true, id: "photo-folder" };
    this.drop = h(
      "section.drop",
      { "aria-label": t("photos.add") },
      icon("upload"),
      h("div", h("p", h("strong", t("photos.drop"))), h("p.small.soft", t("photos.kinds"))),
      h(
        "div.row",
        chooser(t("photos.files"), { drawing: "photos" }, files, take),
        chooser(t("photos.folder"), { drawing: "folder" }, folder, take),
      ),
    );
    return this.drop;
  }

  draw() {
    const { photos, arc, advice } = this.data;
    this.drop.classList.toggle("small-drop", photos.length > 0);
    this.arc.hidden = this.advice.hidden = this.heading.hidden = photos.length === 0;
    if (photos.length) {
      fill(
        this.arc,
        drawArc(arc, photos, (photo) => this.reveal(photo)),
      );
      this.drawAdvice(advice);
    }
    this.drawHeading();
    this.drawSheet();
    this.drawNext();
    this.drawWay();
  }

  drawAdvice(advice) {
    const { checked, looked, faces } = this.data;
    fill(
      this.advice,
      h("h2", t("photos.advice")),
      !checked && h("p.soft", t("photos.unchecked")),
      checked && !advice.length && h("p.note.good", icon("good"), t("photos.well", { n: looked, faces })),
      advice.map((line) => h("p.note.fair", icon("fair"), said(line))),
    );
  }

  drawHeading() {
    const { photos, checking, checked } = this.data;
    const count = (grade) => photos.filter((photo) => photo.grade === grade).length;
    const choices = [
      ["all", t("photos.all"), photos.length],
      ...["green", "yellow", "red", "grey"].map((grade) => [grade, t(`grade.${grade}`), count(grade)]),
    ].filter(([name, , n]) => name === "all" || n);
    fill(
      this.heading,
      h(
        "div.segments",
        { role: "group", "aria-label": t("photos.which") },
        choices.map(([name, text, n]) =>
          h(
            "button",
            {
              "aria-pressed": String(this.filter === name),
              onclick: () => {
                this.filter = name;
                this.drawHeading();
                this.drawSheet();
                this.heading.querySelector("[aria-pressed=true]")?.focus();
              },
            },
            text,
            " ",
            h("span", n),
          ),
        ),
      ),
      checking
        ? h("p.soft", t("photos.checking", { done: checking.done, total: checking.total }))
        : !checked &&
            photos.length > 0 &&
            action(t("photos.check"), { drawing: "eye" }, async () => {
              keepJob(await post(`/api/projects/${this.id}/check`));
              await this.load();
            }),
    );
  }

  drawSheet() {
    const focused = document.activeElement?.closest?.("li.shot-card")?.dataset.photo;
    const { photos } = this.data;
    fill(
      this.sheet,
      photos
        .filter(({ grade }) => this.filter === "all" || grade === this.filter)
        .map((photo) => this.card(photo)),
    );
    if (focused) this.sheet.querySelector(`[data-photo="${focused}"] button`)?.focus({ preventScroll: true });
  }

  card(photo) {
    const reasons = photo.reasons.map((reason) => known("reason", reason)).join(", ");
    const { looked } = this.data;
    // A video has no grade of its own: its frames were looked at.
    const word =
      photo.video && looked && !photo.left_out ? t("photo.frames", { n: looked }) : t(`grade.${photo.grade}`);
    return h(
      "li.shot-card",
      { class: photo.grade, "data-photo": photo.id },
      h(
        "div.frame",
        photo.picture
          ? h("img", {
              slow: photo.picture,
              alt: t("photo.alt", { name: photo.name }),
              decoding: "async",
            })
          : h("div.blank", icon(photo.video ? "play" : "photos")),
      ),
      h("p.name.small", { text: photo.name, title: photo.name }),
      h(
        "p.small.grade",
        MARKS[photo.grade] && icon(MARKS[photo.grade]),
        h("span", reasons || word),
        reasons && h("span.unseen", ` (${word})`),
      ),
      h(
        "div.row",
        action(
          t(photo.left_out ? "photo.take" : "photo.leave"),
          {
            kind: "quiet small",
            "aria-pressed": String(photo.left_out),
            "aria-label": t("photo.leave.one", { name: photo.name }),
          },
          async () => {
            await send("PATCH", `/api/projects/${this.id}/photos/${photo.id}`, {
              left_out: !photo.left_out,
            });
            await this.load();
            this.sheet.querySelector(`[data-photo="${photo.id}"] button`)?.focus({ preventScroll: true });
          },
        ),
        // What is of use stays; it can be left out first. A video would keep all photos away.
        (photo.grade === "red" || photo.left_out || photo.video) &&
          tool("trash", t("photo.remove", { name: photo.name }), async () => {
            await send("DELETE", `/api/projects/${this.id}/photos/${photo.id}`);
            await this.load();
          }),
      ),
    );
  }

  reveal(photo) {
    if (this.filter !== "all") {
      this.filter = "all";
      this.drawHeading();
      this.drawSheet();
    }
    const card = this.sheet.querySelector(`[data-photo="${photo}"]`);
    card?.scrollIntoView({ block: "center" });
    card?.querySelector("button")?.focus({ preventScroll: true });
  }

  /** What is on its way, and what was refused, by name. */
  drawWay() {
    const { total, done, wrong, bytes, sent, have, again } = this.uploads.figures();
    const { busy } = this.uploads;
    if (!total) return fill(this.way);
    const text = busy
      ? t("upload.going", { done, total, sent: size(sent), bytes: size(bytes) })
      : t("upload.done", { n: done - have, have });
    if (!busy || done % 10 === 0) murmur(text);
    fill(
      this.way,
      h(
        "section.card.stack",
        { "aria-label": t("upload.title") },
        h(
          "div.row.between",
          h("p", text),
          busy && button(t("upload.stop"), () => this.uploads.stop(), { kind: "quiet" }),
        ),
        busy && h("progress", { max: bytes || 1, value: sent, "aria-label": t("upload.title") }),
        again > 0 && h("p.note.fair", icon("fair"), t("upload.again", { n: again })),
        wrong.length > 0 &&
          h(
            "details",
            { open: wrong.length < 8 },
            h("summary", t("upload.wrong", { n: wrong.length })),
            h(
              "ul.stack",
              wrong.map(({ name, error }) =>
                h(
                  "li.note.bad",
                  icon("bad"),
                  // Most sentences begin with the file's name already.
                  h("span", !error.startsWith(name) && h("strong", `${name} `), error),
                ),
              ),
            ),
          ),
      ),
    );
  }

  /** The way to the next screen. */
  drawNext() {
    const item = project(this.id);
    if (!item || !this.data) return;
    const enough =
      this.data.photos.some(({ video }) => video) ||
      this.data.photos.filter(({ left_out: out }) => !out).length >= 1;
    const runs = jobsOf(this.id).some(isLive) || item.has.field;
    fill(
      this.next,
      enough &&
        (runs
          ? h("a.button", { href: `#making/${this.id}` }, t("photos.next"))
          : h("a.button.main", { href: `#making/${this.id}` }, t("photos.make"), icon("right"))),
    );
  }
}
