// Screen 3: the stages with time left, the picture of each as soon as it is there, and the queue.

import { post } from "../api.js";
import { check, fill, h, heading, icon } from "../dom.js";
import { duration, known, said, t } from "../i18n.js";
import { action, murmur, tool } from "../shell.js";
import { isLive, jobsOf, keepJob, keepJobs, on, project, state, tell } from "../state.js";
import { Stage } from "../stage.js";
import { leftOfJob, leftOfStage, shareOf, standingOf } from "../times.js";

const HEAVY = ["head", "fine"];
const HEAD = ["capture", "reconstruct", "surface"];
const WHOLE = "whole";

/** What is made; a sitter may have several versions in the queue. */
const nameOfJob = ({ kind, title }) => (title ? `${t(`kind.${kind}`)}: ${title}` : t(`kind.${kind}`));

export async function showMaking(root, sitter) {
  const screen = new Making(root, sitter.id);
  screen.draw();
  return () => screen.close();
}

class Making {
  constructor(root, id) {
    this.id = id;
    this.action = h("div.row");
    this.lead = h("p.lead");
    this.body = h("div.making");
    this.queue = h("section.stack");
    fill(root, heading(t("step.making"), this.lead, this.action), this.body, this.queue);
    this.ends = [
      on("job", () => this.draw()),
      on("state", () => this.draw()),
      on("job-removed", () => this.draw()),
      on("project", (item) => item.id === id && this.draw()),
      on("progress", (data) => this.step(data)),
    ];
    // Between what the server says, time goes on.
    this.clock = setInterval(() => this.tick(), 1000);
  }

  close() {
    clearInterval(this.clock);
    this.head?.stage.close();
    for (const end of this.ends) end();
  }

  /** The job that is shown: what runs, else what ended last. */
  job() {
    const mine = jobsOf(this.id).filter(({ kind }) => HEAVY.includes(kind));
    return mine.find(isLive) ?? mine.at(-1) ?? null;
  }

  draw() {
    const sitter = project(this.id),
      job = this.job();
    if (!sitter) return;
    const same = this.head && this.head.job === job?.id && (isLive(job) || job.state === "done");
    if (same && this.head.shows === WHOLE) {
      this.drawAction(sitter, job);
      return this.drawQueue();
    }
    if (!same) {
      this.head?.stage.close();
      this.head = null;
    }
    const focused = document.activeElement?.dataset?.act;
    this.lead.textContent = t(job?.kind === "fine" ? "making.lead.fine" : "making.lead");
    this.drawAction(sitter, job);
    // A frame that is moved loads its page again: only the list beside it is replaced.
    if (same) this.body.firstElementChild.replaceWith(this.jobView(job)[0]);
    else fill(this.body, job ? this.jobView(job) : this.beginning(sitter));
    this.drawQueue();
    if (focused)
      (this.body.querySelector(`[data-act="${focused}"]`) ?? this.body.querySelector("[data-act]"))?.focus();
  }

  drawAction(sitter, job) {
    if (job && isLive(job)) return fill(this.action);
    fill(
      this.action,
      sitter.has.field &&
        h(
          "a.button.main",
          { href: `#${job?.kind === "fine" ? "portrait" : "style"}/${this.id}` },
          t(job?.kind === "fine" ? "making.portrait" : "making.style"),
          icon("right"),
        ),
    );
  }

  /** Before the first job: what will be done, and the button. */
  beginning(sitter) {
    const can = sitter.demo || sitter.video || sitter.photos >= 1;
    if (!can) {
      return h(
        "div.empty",
        icon("photos"),
        h("h2", t("making.photos.first")),
        h("p", t("making.photos.text")),
        h("a.button.main", { href: `#photos/${this.id}` }, t("step.photos")),
      );
    }
    // One photo or two: a head is fitted to the face.
    const few = !sitter.demo && !sitter.video && sitter.photos <= 2;
    const what = (name) => (few && name !== "surface" ? "few" : "what");
    const quick = check({ id: "quick", checked: sitter.options?.quick }, h("span", t("making.quick")));
    return h(
      "div.card.stack.begin",
      h("h2", t(sitter.has.field ? "making.again" : "making.ready", { n: sitter.photos })),
      h(
        "ol.stack.plan",
        HEAD.map((name) =>
          h("li", h("strong", t(`stage.${name}`)), h("p.soft.small", t(`stage.${name}.${what(name)}`))),
        ),
      ),
      quick,
      h(
        "div",
        action(t("making.start"), { kind: "main", drawing: "play", "data-act": "start" }, () =>
          this.start(quick.input.checked),
        ),
      ),
    );
  }

  async start(quick) {
    keepJob(
      await post("/api/jobs", {
        kind: "head",
        project: this.id,
        ...(quick === null ? {} : { options: { quick } }),
      }),
    );
  }

  jobView(job) {
    const act = (what, text, how) =>
      action(text, { "data-act": what, ...how }, async () =>
        keepJob(await post(`/api/jobs/${job.id}/${what}`)),
      );
    const { state: how } = job;
    if (!this.head) {
      this.still = h("div.still");
      this.picture = h("div.latest", this.still);
    }
    this.total = h("progress", { max: 1, "aria-label": t("making.total") });
    this.left = h("span.soft");
    this.stages = h("ol.stages");
    const whole = [
      h(
        "section.card.stack.stage-list",
        { "aria-label": t("making.stages") },
        h(
          "div.row.between",
          h("h2", nameOfJob(job)),
          h("span.tag", { class: { done: "good", failed: "bad" }[how] ?? "", text: t(`job.${how}`) }),
        ),
        isLive(job) && h("div.stack.tight", this.total, this.left),
        this.stages,
        job.error &&
          h(
            "p.note.bad",
            icon("bad"),
            h(
              "span",
              // How it was ended is all that there is to say; of other errors the message says what.
              job.error.code === "killed"
                ? t("error.killed")
                : `${known("error", job.error.code, "")} ${said(job.error.message)}`.trim(),
            ),
          ),
        job.notes.map((text) => h("p.note.small", icon("info"), said(text))),
        h(
          "div.row",
          how === "running" && state.features?.pause && act("pause", t("job.pause"), { drawing: "pause" }),
          ["paused", "failed", "cancelled"].includes(how) &&
            act("resume", t("job.resume"), { drawing: "play", kind: "main" }),
          isLive(job) && act("cancel", t("job.cancel"), { kind: "quiet" }),
          job.kind === "head" &&
            ["done"].includes(how) &&
            action(t("making.redo"), { kind: "quiet", drawing: "reset", "data-act": "start" }, () =>
              this.start(null),
            ),
        ),
      ),
      this.picture,
    ];
    this.shown = job.id;
    this.fillStages(job);
    return whole;
  }

  fillStages(job) {
    fill(
      this.stages,
      job.stages.map((stage) =>
        h(
          "li.phase",
          { class: stage.state, "aria-current": stage.state === "running" ? "step" : null },
          stage.picture
            ? h("img.small-picture", { src: stage.picture, alt: "", loading: "lazy" })
            : h("span.small-picture"),
          h(
            "div",
            h(
              "div.row.between",
              h("strong", known("stage", stage.name, stage.title)),
              h("span.soft.small.when", this.when(stage, job)),
            ),
            stage.state === "running" &&
              h("progress", {
                max: 1,
                value: stage.progress,
                "aria-label": known("stage", stage.name, stage.title),
              }),
            h("p.soft.small.said", stage.state === "running" ? said(stage.note ?? "") : ""),
          ),
        ),
      ),
    );
    this.times(job);
    this.drawPicture(job);
  }

  when(stage, job) {
    if (stage.state === "running" && job.state === "running") return leftOfStage(stage);
    if (stage.state === "done") return duration(stage.seconds);
    return t(`stagestate.${stage.state}`);
  }

  times(job) {
    const share = shareOf(job);
    this.total.hidden = job.state === "waiting";
    if (share === null) this.total.removeAttribute("value");
    else this.total.value = share;
    this.left.textContent = [
      job.state === "waiting" ? t("job.waiting") : share !== null && `${Math.round(100 * share)} %`,
      job.state === "running" && leftOfJob(job),
      job.state === "waiting" && t("queue.place", { n: job.place + 1 }),
    ]
      .filter(Boolean)
      .join(" · ");
  }

  /** A second later: the same job, with less time left. */
  tick() {
    const job = state.jobs.find(({ id }) => id === this.shown);
    if (job?.state !== "running") return;
    job.stages.forEach((stage, index) => {
      const row = this.stages.children[index];
      if (stage.state === "running" && row) row.querySelector(".when").textContent = this.when(stage, job);
    });
    this.times(job);
  }

  /** A head that turns: itself once it is made, before that as far as it is; whether it is shown. */
  turning(job) {
    const sitter = project(this.id);
    const whole = job.kind === "head" && job.state === "done" && sitter?.has.field;
    const page = whole ? WHOLE : isLive(job) && job.stages.filter((stage) => stage.page).at(-1)?.page;
    if (page && this.head?.shows !== page) {
      if (!this.head) {
        const stage = new Stage(sitter, t("making.head", { name: sitter.name }));
        this.head = { job: job.id, stage, there: false };
        this.picture.append(stage.element);
      }
      const { head, still } = this,
        { element } = head.stage;
      head.shows = page;
      (whole ? head.stage.show({ style: null }) : head.stage.early(page)).then(
        (shown) => {
          head.there ||= Boolean(shown);
          still.hidden = head.there;
          element.classList.toggle("there", head.there);
        },
        () => head.there || element.remove(), // the picture stays, or what turned before
      );
    }
    return Boolean(this.head?.there);
  }

  /** The newest picture, large. */
  drawPicture(job) {
    if (this.turning(job)) return;
    const stage = job.stages.filter(({ picture }) => picture).at(-1);
    const old = this.still.querySelector("img");
    if (!stage) {
      const text = t(job.state === "waiting" ? "making.turn" : isLive(job) ? "making.soon" : "making.none");
      return fill(this.still, h("div.empty", icon("making"), h("p", text)));
    }
    const text = t("stage.alt", { stage: known("stage", stage.name, stage.title) });
    if (old?.getAttribute("src") === stage.picture) return;
    const { still } = this;
    // The old one stays until the new one is there: no flicker while the field turns.
    const next = new Image();
    next.alt = text;
    next.setAttribute("src", stage.picture);
    next
      .decode()
      .then(() => fill(still, next, h("p.soft.small", known("stage", stage.name, stage.title))))
      .catch(() => {});
  }

  /** A little further: numbers and bars alone. */
  step(data) {
    const job = state.jobs.find(({ id }) => id === data.job);
    if (!job || job.id !== this.shown) return;
    const index = job.stages.findIndex(({ name }) => name === data.stage);
    const row = this.stages.children[index];
    if (!row?.querySelector("progress")) return this.fillStages(job);
    const bar = row.querySelector("progress");
    if (data.progress === null) bar.removeAttribute("value");
    else bar.value = data.progress;
    row.querySelector(".said").textContent = said(data.note ?? "");
    row.querySelector(".when").textContent = this.when(job.stages[index], job);
    this.times(job);
    const tens = Math.floor(10 * (job.progress ?? 0));
    if (tens !== this.tens) murmur(`${nameOfJob(job)}: ${this.left.textContent}`);
    this.tens = tens;
  }

  /** All sitters' jobs that run or wait. */
  drawQueue() {
    const waiting = state.jobs.filter((job) => HEAVY.includes(job.kind) && isLive(job));
    this.queue.hidden = waiting.length < 2 && !waiting.some((job) => job.project !== this.id);
    if (this.queue.hidden) return;
    // What runs, then those that wait: the next one's place is 0.
    const turn = (job) => (job.state === "waiting" ? job.place : -1);
    const order = [...waiting].sort((one, other) => turn(one) - turn(other));
    fill(
      this.queue,
      h("h2", t("queue.title")),
      h(
        "ol.queue.stack",
        order.map((job) =>
          h(
            "li.card.row.between",
            h(
              "a",
              { href: `#making/${job.project}` },
              h("strong", { text: job.name ?? job.project, title: job.name ?? job.project }),
              " ",
              h("span.soft", nameOfJob(job)),
            ),
            h(
              "div.row",
              h("span.tag", standingOf(job)),
              job.state === "waiting" &&
                job.place > 0 &&
                action(t("queue.first"), { kind: "quiet" }, async () => {
                  keepJobs((await post(`/api/jobs/${job.id}/move`, { place: 0 })).jobs);
                  tell("state");
                }),
              tool(
                "close",
                t("queue.cancel", { name: `${job.name ?? job.project}, ${nameOfJob(job)}` }),
                async () => keepJob(await post(`/api/jobs/${job.id}/cancel`)),
              ),
            ),
          ),
        ),
      ),
    );
  }
}
